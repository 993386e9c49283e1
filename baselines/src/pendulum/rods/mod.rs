//! The reduced chain in lanes: several rods side by side, each with numbers of its own.
//!
//! These are the equations of [`Chain`] for [`ORDER`] coordinates, divided by the mass of a node,
//! and their exact derivatives. A bank of filters believes in many rods at once: here they share each
//! instruction. Nothing takes memory, and no operation depends on the instruction set.

mod angles;
mod inertia;
mod motion;
mod slope;

use super::{Chain, RodDesign};
use rodgym_core::lane::Real;

pub use angles::{round, sin_cos};
pub use slope::Slope;

/// Coordinates of the model: order 12 at most, whatever the plant.
pub const ORDER: usize = 6;
/// Numbers of a state: coordinates, then rates.
pub const STATE: usize = 2 * ORDER;

/// A vector of coordinates.
pub type Coordinates<R> = [R; ORDER];
/// A state: coordinates, then rates.
pub type State<R> = [R; STATE];

/// Rods side by side, with the same number of nodes.
#[derive(Clone, Debug)]
pub struct Rods<R> {
    /// Rows of S, one an edge. A rod of fewer edges than `ORDER` leaves the last coordinates alone.
    shape: Vec<Coordinates<f64>>,
    coordinates: usize,
    /// Length of an edge \[m\].
    edge: R,
    gravity: R,
    /// Bending stiffness E I / l over a node's mass \[m^2/s^2\].
    stiffness: R,
    /// Kelvin-Voigt time \[s\].
    beta: R,
    /// Nodal drag over a node's mass \[1/s\].
    drag: R,
    /// One over a node's mass \[1/kg\].
    mobility: R,
}

/// How a rod differs from its design: factors of its stiffness and of its mobility.
#[derive(Clone, Copy, Debug)]
pub struct Feel<R> {
    /// Factor of the stiffness.
    pub stiffness: R,
    /// Factor of the mobility (of one over the mass, for the torque).
    pub mobility: R,
}

impl<R: Real> Feel<R> {
    /// As designed.
    #[inline(always)]
    pub fn one() -> Self {
        Feel { stiffness: R::one(), mobility: R::one() }
    }
}

impl<R: Real> Rods<R> {
    /// The rods of a row of designs, one a lane; lanes beyond their number repeat the last.
    ///
    /// # Panics
    /// No rods, or rods whose numbers of nodes differ.
    pub fn new(rods: &[RodDesign]) -> Self {
        assert!(rods.iter().all(|rod| rod.nodes == rods[0].nodes), "rods of one shape");
        let chain = Chain::new(&rods[0], ORDER);
        let matrix = chain.shape();
        let coordinates = chain.coordinates();
        let row =
            |i: usize| std::array::from_fn(|j| if j < coordinates { matrix[(i, j)] } else { 0.0 });
        let lane = |number: fn(&RodDesign) -> f64| {
            R::from_fn(|lane| number(&rods[lane.min(rods.len() - 1)]))
        };
        Rods {
            shape: (0..chain.edges()).map(row).collect(),
            coordinates,
            edge: lane(RodDesign::edge_length),
            gravity: lane(|rod| rod.gravity),
            stiffness: lane(|rod| rod.bending_stiffness() / rod.edge_length() / rod.node_mass()),
            beta: lane(|rod| rod.bending_damping),
            drag: lane(|rod| rod.damping / rod.node_mass()),
            mobility: lane(|rod| 1.0 / rod.node_mass()),
        }
    }

    /// A lane's state as [`Chain`] has it: coordinates in use, then their rates. Returns how many.
    #[inline(always)]
    pub fn lane(&self, x: &State<R>, lane: usize, out: &mut State<f64>) -> usize {
        let k = self.coordinates;
        for i in 0..k {
            out[i] = x[i].get(lane);
            out[k + i] = x[ORDER + i].get(lane);
        }
        2 * k
    }

    /// Row of S of the base edge: base angle = row . q.
    #[inline(always)]
    pub fn base(&self) -> &Coordinates<f64> {
        &self.shape[0]
    }

    /// Coordinates of straight rods at an angle (or rates, from a rate).
    #[inline(always)]
    pub fn straight(&self, angle: R) -> Coordinates<R> {
        let mut q = [R::zero(); ORDER];
        for row in &self.shape {
            for j in 0..ORDER {
                q[j] += R::splat(row[j]) * angle;
            }
        }
        q
    }
}

#[cfg(test)]
mod tests {
    //! Rods side by side move as the reduced chain does, and their derivatives are those of differences.

    use super::*;
    use rodgym_core::lane::Lanes;
    use rodgym_core::seed::Stream;

    fn rods() -> Vec<RodDesign> {
        let rod = |width: f64, youngs_modulus: f64| RodDesign {
            width,
            youngs_modulus,
            nodes: 13,
            damping: 1e-3,
            ..RodDesign::default()
        };
        vec![rod(0.006, 1e7), rod(0.009, 1e7), rod(0.007, 6e6)]
    }

    fn bent(stream: &mut Stream) -> State<f64> {
        let mut x = [0.0; STATE];
        x[0] = stream.uniform(-20.0, 20.0);
        x[ORDER] = stream.uniform(-30.0, 30.0);
        for i in 1..ORDER {
            x[i] = stream.uniform(-0.5, 0.5);
            x[ORDER + i] = stream.uniform(-10.0, 10.0);
        }
        x
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }
    #[test]
    fn accelerations_are_those_of_the_chain() {
        let mut stream = Stream::new(2);
        for rod in rods() {
            let (chain, one) =
                (Chain::new(&rod, ORDER), Rods::<f64>::new(std::slice::from_ref(&rod)));
            for _ in 0..100 {
                let (x, torque) = (bent(&mut stream), stream.uniform(-0.05, 0.05));
                let mut wanted = [0.0; ORDER];
                chain.acceleration(&x[..ORDER], &x[ORDER..], torque, &mut wanted);
                let got = one.acceleration(&x, torque, &Feel::one());
                let size = wanted.iter().fold(1.0, |size: f64, a| size.max(a.abs()));
                assert!(distance(&got, &wanted) < 1e-10 * size, "{got:?} is not {wanted:?}");
            }
        }
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let rod = &rods()[0];
        let rods = Rods::<f64>::new(std::slice::from_ref(rod));
        let mut stream = Stream::new(3);
        for _ in 0..50 {
            let (x, torque) = (bent(&mut stream), stream.uniform(-0.05, 0.05));
            let slope = rods.slope(&x, torque, &Feel::one());
            let check = |column: Coordinates<f64>, h: f64, at: &dyn Fn(f64) -> Coordinates<f64>| {
                let (plus, minus) = (at(h), at(-h));
                let wanted: Vec<f64> =
                    plus.iter().zip(&minus).map(|(p, m)| (p - m) / (2.0 * h)).collect();
                let size = wanted.iter().fold(1.0, |size: f64, a| size.max(a.abs()));
                assert!(distance(&column, &wanted) < 1e-5 * size, "{column:?} is not {wanted:?}");
            };
            for k in 0..ORDER {
                let by = |i: usize| {
                    move |h: f64| {
                        let mut x = x;
                        x[i] += h;
                        x
                    }
                };
                let column = |m: &[Coordinates<f64>; ORDER]| std::array::from_fn(|j| m[j][k]);
                let at = |i: usize, h: f64| rods.acceleration(&by(i)(h), torque, &Feel::one());
                check(column(&slope.angle), 1e-5, &|h| at(k, h));
                check(column(&slope.rate), 1e-4, &|h| at(ORDER + k, h));
            }
            let feel = |stiffness, mobility| Feel { stiffness, mobility };
            let at = |feel: Feel<f64>| rods.acceleration(&x, torque, &feel);
            check(slope.stiffness, 1e-5, &|h| at(feel(libm::exp(h), 1.0)));
            check(slope.mobility, 1e-5, &|h| at(feel(1.0, libm::exp(h))));
        }
    }

    /// Rods in lanes hold the bits of each alone.
    #[test]
    fn lanes_do_not_disturb_each_other() {
        let all = rods();
        let side_by_side = Rods::<Lanes<8>>::new(&all);
        let mut stream = Stream::new(4);
        let states: Vec<State<f64>> = all.iter().map(|_| bent(&mut stream)).collect();
        let mut x: State<Lanes<8>> =
            std::array::from_fn(|i| Lanes::from_fn(|lane| states[lane.min(2)][i]));
        side_by_side.step(&mut x, Lanes::splat(0.02), &Feel::one(), 2e-3);
        for (lane, (rod, state)) in all.iter().zip(states).enumerate() {
            let mut alone = state;
            Rods::<f64>::new(std::slice::from_ref(rod)).step(&mut alone, 0.02, &Feel::one(), 2e-3);
            assert!((0..STATE).all(|i| alone[i].to_bits() == x[i].get(lane).to_bits()));
        }
    }
}
