//! Forms of quantities, their axes and grids.

use std::fmt::Display;
use std::marker::PhantomData;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::ir::VarId;
use crate::model::number::{Number, present};
use crate::model::{Axis, Grid, Quantity};

#[derive(Serialize, Deserialize)]
#[serde(remote = "Quantity", deny_unknown_fields)]
pub(super) struct QuantityForm {
    #[serde(rename = "variable", deserialize_with = "present")]
    var: Option<VarId>,
    name: String,
    #[serde(with = "ListOf::<AxisForm>")]
    axes: Vec<Axis>,
    #[serde(deserialize_with = "present")]
    pattern: Option<String>,
    unit: String,
    text: String,
    #[serde(with = "ListOf::<Low>")]
    low: Vec<f64>,
    #[serde(with = "ListOf::<High>")]
    high: Vec<f64>,
    #[serde(with = "ListOf::<Known>")]
    default: Vec<f64>,
    #[serde(with = "ListOf::<Known>")]
    scale: Vec<f64>,
    affine_unit: bool,
    structural: bool,
    #[serde(default, skip_serializing_if = "is_false")]
    nonnegative: bool,
}

fn is_false(flag: &bool) -> bool {
    !flag
}

/// Writes and reads lists of a type by way of another one, `with = "ListOf::<Number>"`.
struct ListOf<F>(PhantomData<F>);

impl<F> ListOf<F> {
    fn serialize<T: Clone + Into<F>, S: Serializer>(list: &[T], serializer: S) -> Result<S::Ok, S::Error>
    where
        F: Serialize,
    {
        serializer.collect_seq(list.iter().cloned().map(Into::into))
    }

    fn deserialize<'de, T, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error>
    where
        F: Deserialize<'de> + TryInto<T>,
        F::Error: Display,
    {
        Vec::<F>::deserialize(deserializer)?.into_iter().map(|form| form.try_into().map_err(D::Error::custom)).collect()
    }
}

/// Numbers with `null` for the one that means a missing number.
macro_rules! or_null {
    ($($name:ident: $none:expr;)*) => {$(
        #[derive(Serialize, Deserialize)]
        struct $name(Option<Number>);

        impl From<f64> for $name {
            fn from(x: f64) -> Self {
                let none: f64 = $none;
                let is_none = if none.is_nan() { x.is_nan() } else { x.total_cmp(&none).is_eq() };
                $name((!is_none).then_some(Number(x)))
            }
        }

        impl From<$name> for f64 {
            fn from(x: $name) -> f64 {
                x.0.map_or($none, f64::from)
            }
        }
    )*};
}

or_null! {
    Low: f64::NEG_INFINITY;
    High: f64::INFINITY;
    Known: f64::NAN;
}

/// An axis: `{"names": [..]}`, `{"first": 1, "count": 3, "set": "s"}` or `{"grid": 0, "count":
/// 40}`.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisForm {
    #[serde(skip_serializing_if = "Option::is_none")]
    names: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first: Option<i64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    grid: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    count: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    set: Option<String>,
}

impl From<Axis> for AxisForm {
    fn from(axis: Axis) -> Self {
        let none = AxisForm::default();
        match axis {
            Axis::Names(names) => AxisForm { names: Some(names), ..none },
            Axis::Numbers { first, count, set } => {
                AxisForm { first: Some(first), count: Some(count), set: Some(set).filter(|set| !set.is_empty()), ..none }
            }
            Axis::Cells { grid, count } => AxisForm { grid: Some(grid), count: Some(count), ..none },
        }
    }
}

impl TryFrom<AxisForm> for Axis {
    type Error = &'static str;

    fn try_from(form: AxisForm) -> Result<Axis, &'static str> {
        // Labels stay far from the ends of 64 bits.
        match form {
            AxisForm { names: Some(names), first: None, grid: None, count: None, set: None } => Ok(Axis::Names(names)),
            AxisForm { first: Some(first), count: Some(count), set, names: None, grid: None } if first.abs() <= 1 << 40 => {
                Ok(Axis::Numbers { first, count, set: set.unwrap_or_default() })
            }
            AxisForm { grid: Some(grid), count: Some(count), names: None, first: None, set: None } => Ok(Axis::Cells { grid, count }),
            _ => Err("an axis has `names`, or `first` up to 2^40 and `count`, or `grid` and `count`"),
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Grid", deny_unknown_fields)]
pub(super) struct GridForm {
    name: String,
    unit: String,
    #[serde(with = "ListOf::<Number>")]
    faces: Vec<f64>,
    #[serde(with = "ListOf::<GridParameterForm>")]
    parameters: Vec<(VarId, u32, f64)>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GridParameterForm {
    variable: VarId,
    element: u32,
    value: Number,
}

impl From<(VarId, u32, f64)> for GridParameterForm {
    fn from((variable, element, value): (VarId, u32, f64)) -> Self {
        GridParameterForm { variable, element, value: Number(value) }
    }
}

impl From<GridParameterForm> for (VarId, u32, f64) {
    fn from(form: GridParameterForm) -> Self {
        (form.variable, form.element, form.value.0)
    }
}
