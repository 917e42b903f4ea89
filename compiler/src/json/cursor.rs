//! A place in a JSON text, which knows how it was reached: errors name it.

use std::fmt;

use serde_json::{Map, Value};
use thiserror::Error;

use super::words::{Word, meaning};

/// Most elements of all variables together.
pub(super) const MAX_ELEMENTS: usize = 50_000_000;

/// Reason why a text is not a model.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ReadError {
    /// It is not JSON.
    #[error("not JSON: {0}")]
    Syntax(String),
    /// Another form, or another version of it.
    #[error("version {found} of the form; this program reads version {expected}: export the model again")]
    Version {
        /// The version in the text.
        found: String,
        /// That of this program.
        expected: u32,
    },
    /// Something at a place is not as it has to be.
    #[error("{path}: {message}")]
    Place {
        /// Way to the place, `programs.start.nests[2].extents`.
        path: String,
        /// Error.
        message: String,
    },
}

#[derive(Clone, Copy)]
enum Step<'a> {
    Field(&'a str),
    Item(usize),
}

/// A value and the way to it.
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    value: &'a Value,
    way: Option<(&'a At<'a>, Step<'a>)>,
}

impl fmt::Display for At<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((parent, step)) = self.way else { return Ok(()) };
        parent.fmt(f)?;
        match step {
            Step::Field(name) if parent.way.is_none() => f.write_str(name),
            Step::Field(name) => write!(f, ".{name}"),
            Step::Item(i) => write!(f, "[{i}]"),
        }
    }
}

impl<'a> At<'a> {
    /// The whole text.
    pub(super) fn root(value: &'a Value) -> At<'a> {
        At { value, way: None }
    }

    /// An error at this place.
    pub(super) fn fault(&self, message: impl Into<String>) -> ReadError {
        let path = match self.to_string() {
            path if path.is_empty() => "the whole".to_owned(),
            path => path,
        };
        ReadError::Place { path, message: message.into() }
    }

    fn kind(&self) -> String {
        match self.value {
            Value::Null => "null".into(),
            Value::Bool(b) => b.to_string(),
            Value::Number(n) => n.to_string(),
            Value::String(s) if s.chars().count() <= 40 => format!("{s:?}"),
            Value::String(_) => "a long text".into(),
            Value::Array(items) => format!("a list of {}", items.len()),
            Value::Object(_) => "an object".into(),
        }
    }

    fn expected(&self, what: &str) -> ReadError {
        self.fault(format!("expected {what}, found {}", self.kind()))
    }

    fn map(&self) -> Result<&'a Map<String, Value>, ReadError> {
        self.value.as_object().ok_or_else(|| self.expected("an object"))
    }

    /// Refuses an object with other fields than these.
    pub(super) fn only(&self, fields: &[&str]) -> Result<(), ReadError> {
        match self.map()?.keys().find(|key| !fields.contains(&key.as_str())) {
            Some(key) => Err(self.fault(format!("unknown field `{}`; known: {}", short(key), fields.join(", ")))),
            None => Ok(()),
        }
    }

    /// A field that has to be there.
    pub(super) fn field(&'a self, name: &'a str) -> Result<At<'a>, ReadError> {
        let value = self.map()?.get(name).ok_or_else(|| self.fault(format!("the field `{name}` is missing")))?;
        Ok(At { value, way: Some((self, Step::Field(name))) })
    }

    /// A field that may be absent.
    pub(super) fn maybe(&'a self, name: &'a str) -> Result<Option<At<'a>>, ReadError> {
        Ok(self.map()?.get(name).map(|value| At { value, way: Some((self, Step::Field(name))) }))
    }

    /// All fields in their order.
    pub(super) fn fields(&'a self) -> Result<impl Iterator<Item = (&'a str, At<'a>)>, ReadError> {
        Ok(self.map()?.iter().map(|(name, value)| (name.as_str(), At { value, way: Some((self, Step::Field(name))) })))
    }

    /// The items of a list.
    pub(super) fn items(&'a self) -> Result<impl ExactSizeIterator<Item = At<'a>>, ReadError> {
        let items = self.value.as_array().ok_or_else(|| self.expected("a list"))?;
        Ok(items.iter().enumerate().map(|(i, value)| At { value, way: Some((self, Step::Item(i))) }))
    }

    /// The items of a list, each made into something.
    pub(super) fn list<T>(&self, make: impl Fn(&At<'_>) -> Result<T, ReadError>) -> Result<Vec<T>, ReadError> {
        self.items()?.map(|item| make(&item)).collect()
    }

    pub(super) fn is_null(&self) -> bool {
        self.value.is_null()
    }

    pub(super) fn value(&self) -> &'a Value {
        self.value
    }

    pub(super) fn text(&self) -> Result<&'a str, ReadError> {
        self.value.as_str().ok_or_else(|| self.expected("a text"))
    }

    pub(super) fn string(&self) -> Result<String, ReadError> {
        self.text().map(str::to_owned)
    }

    pub(super) fn flag(&self) -> Result<bool, ReadError> {
        self.value.as_bool().ok_or_else(|| self.expected("true or false"))
    }

    /// A whole number up to a limit.
    pub(super) fn count(&self, limit: u32) -> Result<u32, ReadError> {
        let count = self.value.as_u64().ok_or_else(|| self.expected("a whole number"))?;
        u32::try_from(count).ok().filter(|&n| n <= limit).ok_or_else(|| self.fault(format!("{count} is more than {limit}")))
    }

    /// A position in a list of that length.
    pub(super) fn index(&self, len: usize, of: &str) -> Result<usize, ReadError> {
        let index = self.value.as_u64().ok_or_else(|| self.expected("a position"))?;
        usize::try_from(index).ok().filter(|&i| i < len).ok_or_else(|| self.fault(format!("there is no {of} {index}, there are {len}")))
    }

    /// A whole number of any sign that is no larger than a limit.
    pub(super) fn integer(&self, limit: i64) -> Result<i64, ReadError> {
        let number = self.value.as_i64().ok_or_else(|| self.expected("a whole number"))?;
        if (-limit..=limit).contains(&number) { Ok(number) } else { Err(self.fault(format!("{number} is beyond {limit}"))) }
    }

    /// A number, or the word for one that JSON does not have.
    pub(super) fn number(&self) -> Result<f64, ReadError> {
        match self.value {
            Value::String(word) => match word.as_str() {
                "nan" => Ok(f64::NAN),
                "inf" => Ok(f64::INFINITY),
                "-inf" => Ok(f64::NEG_INFINITY),
                _ => Err(self.expected("a number, \"inf\", \"-inf\" or \"nan\"")),
            },
            value => value.as_f64().ok_or_else(|| self.expected("a number")),
        }
    }

    /// A number, or null for the one that stands for none.
    pub(super) fn number_or(&self, none: f64) -> Result<f64, ReadError> {
        if self.is_null() { Ok(none) } else { self.number() }
    }

    /// A finite number that passes a test.
    pub(super) fn number_that(&self, is: &str, test: impl Fn(f64) -> bool) -> Result<f64, ReadError> {
        let x = self.number()?;
        if test(x) { Ok(x) } else { Err(self.fault(format!("expected a number that is {is}, found {x}"))) }
    }

    /// The meaning of a word.
    pub(super) fn word<T: Word>(&self) -> Result<T, ReadError> {
        let text = self.text()?;
        let known = || T::ALL.iter().map(|known| known.word()).collect::<Vec<_>>().join(", ");
        meaning(text).ok_or_else(|| self.fault(format!("unknown word `{}`; known: {}", short(text), known())))
    }
}

/// A name as messages show it.
fn short(name: &str) -> String {
    if name.chars().count() <= 40 { name.to_owned() } else { name.chars().take(40).chain("...".chars()).collect() }
}
