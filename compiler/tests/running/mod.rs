//! Models compiled from text, with what they give at one point.
#![allow(dead_code, reason = "each test needs some of it")]

use smpl_compiler::compile::flatten;
use smpl_compiler::compiled::{BackEndSettings, CompiledModel, FramePart, Memory, Region};
use smpl_compiler::elaborate::Options;
use smpl_compiler::model::{Model, Quantity};
use smpl_dsl::diagnostic::SourceMap;

/// A compiled model at its start.
pub struct Running {
    pub model: CompiledModel,
    pub memory: Memory,
    pub y: Vec<f64>,
    pub yp: Vec<f64>,
    pub t: f64,
}

/// The flat model of a text.
pub fn flat(source: &str) -> Model {
    flat_with(source, &Options { verify: true, ..Options::default() })
}

/// The flat model of a text with variants and settings.
pub fn flat_with(source: &str, options: &Options) -> Model {
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", source);
    match flatten(&mut sources, main, &mut |_| None, options) {
        Ok((model, _)) => model,
        Err(faults) => panic!("{}\n{source}", faults.iter().map(|f| f.message.clone()).collect::<Vec<_>>().join("\n")),
    }
}

impl Running {
    /// Compiles a text and takes the initial values.
    pub fn new(source: &str) -> Running {
        Running::of(flat(source))
    }

    pub fn of(model: Model) -> Running {
        let model = CompiledModel::build(model, &BackEndSettings::default()).expect("machine code");
        let memory = model.memory();
        let (y, yp) = (vec![0.0; model.unknowns()], vec![0.0; model.unknowns()]);
        let mut running = Running { model, memory, y, yp, t: 0.0 };
        running.restart();
        running
    }

    /// Computes everything that depends on parameters, and the initial values.
    pub fn restart(&mut self) {
        let Running { model, memory, y, .. } = self;
        model.parameters(memory);
        model.prepare_parameters(memory);
        model.initial_states(memory, y);
        model.initial_discretes(memory, y);
        model.prepare_step(memory);
    }

    /// Unknown elements by name.
    pub fn names(&self) -> Vec<String> {
        let i = self.model.interface();
        i.quantities.states.iter().chain(&i.quantities.solved).flat_map(|q| (0..q.len()).map(|e| q.element_name(e))).collect()
    }

    fn position(&self, name: &str) -> usize {
        let names = self.names();
        names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no unknown `{name}` among {names:?}"))
    }

    pub fn set(&mut self, name: &str, value: f64) -> &mut Self {
        let at = self.position(name);
        self.y[at] = value;
        self
    }

    pub fn get(&self, name: &str) -> f64 {
        self.y[self.position(name)]
    }

    /// All residuals with rates of zero: for explicit rows the rates.
    pub fn rates(&mut self) -> Vec<f64> {
        let Running { model, memory, y, yp, t } = self;
        let mut out = vec![f64::NAN; y.len()];
        model.prepare_step(memory);
        model.residual(memory, *t, y, yp, &mut out);
        out
    }

    /// The residual of one unknown.
    pub fn rate(&mut self, name: &str) -> f64 {
        let at = self.position(name);
        self.rates()[at]
    }

    /// An algebraic output by name.
    pub fn output(&mut self, name: &str) -> f64 {
        let names: Vec<String> =
            self.model.interface().quantities.algebraics.iter().flat_map(|q| (0..q.len()).map(|e| q.element_name(e))).collect();
        let Running { model, memory, y, yp, t } = self;
        let mut out = vec![f64::NAN; names.len()];
        model.prepare_step(memory);
        model.outputs(memory, *t, y, yp, &mut out);
        let at = names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no output `{name}` among {names:?}"));
        out[at]
    }

    /// Everything that is worked out at the end of a step.
    pub fn finish(&mut self) -> Vec<f64> {
        let Running { model, memory, y, yp, t } = self;
        let mut out = vec![f64::NAN; model.finish_len()];
        model.prepare_step(memory);
        model.finish(memory, *t, y, yp, &mut out);
        out
    }

    /// A reward by its number.
    pub fn reward(&mut self, index: usize) -> f64 {
        let at = self.model.interface().finish.layout().rewards.start;
        self.finish()[at + index]
    }

    /// An observation by its name.
    pub fn observation(&mut self, name: &str) -> f64 {
        let i = self.model.interface();
        let at = i.finish.observations.iter().position(|o| o.name == name).expect("an observation");
        let first = i.finish.layout().observations.start;
        self.finish()[first + at]
    }

    fn slot(&self, list: &[Quantity], name: &str) -> usize {
        let find = |q: &Quantity| {
            let e = (0..q.len()).find(|&e| q.element_name(e) == name)?;
            Some(self.model.offset(q.var?)? + e)
        };
        list.iter().find_map(find).unwrap_or_else(|| panic!("no `{name}`"))
    }

    pub fn parameter(&self, name: &str) -> f64 {
        self.memory.region(Region::Param)[self.slot(&self.model.interface().quantities.parameters, name)]
    }

    /// Gives a parameter a value from outside.
    pub fn give(&mut self, name: &str, value: f64) {
        let at = self.slot(&self.model.interface().quantities.parameters, name);
        self.memory.region_mut(Region::Param)[at] = value;
        self.memory.region_mut(Region::ParamGiven)[at] = 1.0;
        self.restart();
    }

    pub fn discrete(&self, name: &str) -> f64 {
        self.memory.region(Region::Discrete)[self.slot(&self.model.interface().quantities.discretes, name)]
    }

    pub fn set_discrete(&mut self, name: &str, value: f64) {
        let at = self.slot(&self.model.interface().quantities.discretes, name);
        self.memory.region_mut(Region::Discrete)[at] = value;
    }

    pub fn set_action(&mut self, name: &str, value: f64) {
        let at = self.slot(&self.model.interface().quantities.actions, name);
        self.memory.region_mut(Region::Action)[at] = value;
    }

    /// Sets all unknowns of a frame.
    pub fn set_frame(&mut self, frame: fn(FramePart) -> Region, values: &[f64]) {
        self.memory.region_mut(frame(FramePart::Y)).copy_from_slice(values);
    }
}

/// Agreement to a few roundings.
#[track_caller]
pub fn assert_close(found: f64, expected: f64) {
    let agree = found == expected || (found - expected).abs() <= 1e-13 * expected.abs().max(1e-300) || found.is_nan() && expected.is_nan();
    assert!(agree, "found {found}, expected {expected}");
}
