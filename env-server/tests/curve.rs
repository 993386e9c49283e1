//! The libzmq in here has CURVE, whatever the registry's build would have.
#![cfg(feature = "zmq")]

#[test]
fn libzmq_is_ours_and_has_curve() {
    assert_eq!(zmq::version(), (4, 3, 5));
    assert_eq!(zmq::has("curve"), Some(true));
    assert_ne!(zmq::CurveKeyPair::new().expect("keys can be made").secret_key, [0; 32]);
}
