//! Addresses as lists.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::ir::{Affine, MAX_DEPTH};

/// Largest offset and factor: sums of products with passes stay far from the ends of 64 bits.
const MAX_STRIDE: i64 = 1 << 32;

/// Offset, then the factor of each loop counter up to the last that occurs.
pub(super) struct Address(pub Affine);

impl Serialize for Address {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serialize(&self.0, serializer)
    }
}

impl<'de> Deserialize<'de> for Address {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserialize(deserializer).map(Address)
    }
}

pub(super) fn serialize<S: Serializer>(at: &Affine, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq([at.offset].iter().chain(&at.strides[..usize::from(at.depth())]))
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Affine, D::Error> {
    let numbers = Vec::<i64>::deserialize(deserializer)?;
    let (Some((&offset, factors)), true) = (numbers.split_first(), numbers.len() <= MAX_DEPTH + 1) else {
        return Err(D::Error::custom(format!("an address has an offset and up to {MAX_DEPTH} factors")));
    };
    if let Some(number) = numbers.iter().find(|number| !(-MAX_STRIDE..=MAX_STRIDE).contains(*number)) {
        return Err(D::Error::custom(format!("{number} is beyond {MAX_STRIDE}")));
    }
    let mut at = Affine::constant(offset);
    at.strides.iter_mut().zip(factors).for_each(|(stride, factor)| *stride = *factor);
    Ok(at)
}
