//! Settings of a client.

use serde_json::Value;
use smpl_analysis::hints::HintKind;

/// Features that a client can turn off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    units: bool,
    values: bool,
    indices: bool,
    /// Code lenses.
    pub(super) lenses: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { units: true, values: true, indices: true, lenses: true }
    }
}

impl Settings {
    /// Takes over what an object says: `{"inlayHints": {"units": false}, "codeLens": false}`, alone
    /// or under `smpl`.
    pub(super) fn read(&mut self, value: &Value) {
        let value = value.get("smpl").unwrap_or(value);
        let hints = value.get("inlayHints");
        let flag = |of: Option<&Value>, name: &str| of.and_then(|of| of.get(name)).and_then(Value::as_bool);
        if let Some(Value::Bool(all)) = hints {
            (self.units, self.values, self.indices) = (*all, *all, *all);
        }
        self.units = flag(hints, "units").unwrap_or(self.units);
        self.values = flag(hints, "values").unwrap_or(self.values);
        self.indices = flag(hints, "indices").unwrap_or(self.indices);
        self.lenses = flag(Some(value), "codeLens").unwrap_or(self.lenses);
    }

    /// Returns whether a kind of hint is shown.
    pub(super) fn shows(&self, kind: HintKind) -> bool {
        match kind {
            HintKind::Unit => self.units,
            HintKind::Value => self.values,
            HintKind::Index => self.indices,
        }
    }
}
