//! Reader of the values of a scenario: errors have places, and a mapping has no repeated keys.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, MapAccess, SeqAccess, Visitor};

use super::{Disturbances, Noise, Recorded, TWICE, Value};

/// A mapping from names to values without duplicate names.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entries<V>(pub BTreeMap<String, V>);

impl<V> Default for Entries<V> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<'de, V: Deserialize<'de>> Deserialize<'de> for Entries<V> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Names<V>(PhantomData<V>);
        impl<'de, V: Deserialize<'de>> Visitor<'de> for Names<V> {
            type Value = Entries<V>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a mapping from names to values")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut entries = BTreeMap::new();
                while let Some(name) = map.next_key::<String>()? {
                    if entries.contains_key(&name) {
                        return Err(A::Error::custom(format!("`{name}` {TWICE}")));
                    }
                    entries.insert(name, map.next_value()?);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(Names(PhantomData))
    }
}

/// Implements `Deserialize` by a visitor that takes what the given methods take.
macro_rules! read {
    ($type:ty, $expecting:literal, { $($methods:tt)* }) => {
        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Kinds;
                impl<'de> Visitor<'de> for Kinds {
                    type Value = $type;

                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($expecting)
                    }

                    $($methods)*
                }
                deserializer.deserialize_any(Kinds)
            }
        }
    };
}

read!(Value, "a number, a list of numbers, true, false or a text", {
    fn visit_bool<E: Error>(self, flag: bool) -> Result<Self::Value, E> {
        Ok(Value::Flag(flag))
    }

    fn visit_i64<E: Error>(self, x: i64) -> Result<Self::Value, E> {
        Ok(Value::Number(x as f64))
    }

    fn visit_u64<E: Error>(self, x: u64) -> Result<Self::Value, E> {
        Ok(Value::Number(x as f64))
    }

    fn visit_f64<E: Error>(self, x: f64) -> Result<Self::Value, E> {
        Ok(Value::Number(x))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        Ok(Value::Text(text.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        Deserialize::deserialize(SeqAccessDeserializer::new(list)).map(Value::List)
    }
});

read!(Noise, "true, false or a mapping from observations to standard deviations", {
    fn visit_bool<E: Error>(self, flag: bool) -> Result<Self::Value, E> {
        Ok(Noise::Switch(flag))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        Entries::deserialize(MapAccessDeserializer::new(map)).map(|entries| Noise::Deviations(entries.0))
    }
});

read!(Disturbances, "true, false or a mapping from names to values", {
    fn visit_bool<E: Error>(self, flag: bool) -> Result<Self::Value, E> {
        Ok(Disturbances::Switch(flag))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        Entries::deserialize(MapAccessDeserializer::new(map)).map(|entries| Disturbances::Values(entries.0))
    }
});

/// A sequence with what is to become of its last value, or a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Data {
    values: Option<Vec<f64>>,
    hold: Option<bool>,
    from: Option<String>,
    reading: Option<String>,
    outside: Option<String>,
}

impl Data {
    fn recorded(self) -> Result<Recorded, &'static str> {
        match self {
            Data { values: Some(values), hold, from: None, reading: None, outside: None } => {
                Ok(Recorded::Sequence { values, hold: hold.unwrap_or(false) })
            }
            Data { values: None, hold: None, from: Some(path), reading, outside } => Ok(Recorded::File { path, reading, outside }),
            Data { values: None, from: None, .. } => Err("a disturbance has `values`, or `from` with the path of a file"),
            _ => Err("a disturbance has `values` and `hold`, or `from`, `reading` and `outside`"),
        }
    }
}

read!(Recorded, "a number, a list of numbers (one a step), `{values: [...], hold: true}` or `{from: \"data.csv\"}`", {
    fn visit_i64<E: Error>(self, x: i64) -> Result<Self::Value, E> {
        Ok(Recorded::Constant(x as f64))
    }

    fn visit_u64<E: Error>(self, x: u64) -> Result<Self::Value, E> {
        Ok(Recorded::Constant(x as f64))
    }

    fn visit_f64<E: Error>(self, x: f64) -> Result<Self::Value, E> {
        Ok(Recorded::Constant(x))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        let values = Deserialize::deserialize(SeqAccessDeserializer::new(list))?;
        Ok(Recorded::Sequence { values, hold: false })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        Data::deserialize(MapAccessDeserializer::new(map))?.recorded().map_err(A::Error::custom)
    }
});
