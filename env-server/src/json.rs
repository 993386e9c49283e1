//! msgpack that JSON could say too, and nothing else: whatever would arrive as another value than it was
//! sent is refused.

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::fmt;

/// A value of JSON's kinds: null, bool, integers of 64 bits, finite numbers, text, lists, and maps with
/// text keys, each once.
pub struct Json(pub Value);

impl<'de> Deserialize<'de> for Json {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AnyValue).map(Json)
    }
}

struct AnyValue;

impl<'de> Visitor<'de> for AnyValue {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value that JSON has: no binary, no extension types")
    }
    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }
    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }
    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }
    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        // serde_json would make null of it, and null is a default: another physics.
        let number = serde_json::Number::from_f64(value);
        number.map(Value::Number).ok_or_else(|| E::custom(format!("{value} is no number of JSON")))
    }
    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        // What the sender promises is not allocated before it comes.
        let mut values = Vec::new();
        while let Some(Json(value)) = list.next_element()? {
            values.push(value);
        }
        Ok(Value::Array(values))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Value, A::Error> {
        let mut values = Map::new();
        while let Some(Key(key)) = map.next_key()? {
            let Json(value) = map.next_value()?;
            if values.contains_key(&key) {
                return Err(A::Error::custom(format!("key '{key}' comes twice")));
            }
            values.insert(key, value);
        }
        Ok(Value::Object(values))
    }
}

/// A key of a map: text.
struct Key(String);

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;
        impl Visitor<'_> for Text {
            type Value = Key;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a text as key")
            }
            fn visit_str<E: Error>(self, value: &str) -> Result<Key, E> {
                Ok(Key(value.into()))
            }
        }
        // `any`: asked for text, the reader would take binary too.
        deserializer.deserialize_any(Text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(bytes: &[u8]) -> Result<Value, String> {
        rmp_serde::from_slice::<Json>(bytes).map(|json| json.0).map_err(|e| e.to_string())
    }

    #[test]
    fn what_json_can_say_arrives_as_it_was_sent() {
        let all = json!({"a": [null, true, -1, u64::MAX, i64::MIN, 0.1, -0.0, "ä"], "b": {"": {}}});
        assert_eq!(read(&rmp_serde::to_vec(&all).expect("it is JSON")), Ok(all));
        // A float of 32 bits is the number that it is.
        assert_eq!(read(&[0xca, 0x3f, 0x00, 0x00, 0x00]), Ok(json!(0.5)));
    }

    #[test]
    fn what_json_cannot_say_is_refused() {
        let refused: [(&[u8], &str); 12] = [
            (&[0xcb, 0x7f, 0xf8, 0, 0, 0, 0, 0, 0], "NaN"),
            (&[0xcb, 0x7f, 0xf0, 0, 0, 0, 0, 0, 0], "inf"),
            (&[0xcb, 0xff, 0xf0, 0, 0, 0, 0, 0, 0], "-inf"),
            (&[0xca, 0x7f, 0xc0, 0, 0], "NaN"),
            (&[0x91, 0xca, 0x7f, 0x80, 0, 0], "inf"),
            (&[0xc4, 1, b'a'], "JSON"),
            (&[0xd4, 1, 0], ""),
            (&[0xd6, 0xff, 0, 0, 0, 0], ""),
            (&[0x81, 0, 1], "text"),
            (&[0x81, 0xc4, 1, b'a', 1], "text"),
            (&[0x81, 0xc0, 1], "text"),
            (&[0x82, 0xa1, b'a', 1, 0xa1, b'a', 2], "twice"),
        ];
        for (bytes, word) in refused {
            let error = read(bytes).expect_err("it is not JSON");
            assert!(error.contains(word), "{bytes:?}: {error}");
        }
        // Text that is not UTF-8.
        assert!(read(&[0xa1, 0xff]).is_err());
    }
}
