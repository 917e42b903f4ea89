//! Derivatives of everything that an instance holds, along a number of directions.

use std::ops::Range;

use smpl_compiler::compiled::tangent::{Dual, LANES, STILL, Tangent, TangentProgram, TangentView};
use smpl_compiler::layout::{FramePart, Region};

use crate::system::CompiledSystem;

/// Derivatives of the unknowns and of the workspace, in chunks of [`LANES`] directions.
pub(crate) struct Tangents {
    width: usize,
    chunks: Vec<Chunk>,
    /// Copies that programs write to.
    y: Vec<f64>,
    yp: Vec<f64>,
    memory: Vec<f64>,
    out: Vec<f64>,
    registers: Vec<Dual>,
}

struct Chunk {
    y: Vec<Tangent>,
    yp: Vec<Tangent>,
    work: Vec<Tangent>,
    out: Vec<Tangent>,
}

/// Point of a program: time with its derivatives along the directions, unknowns, their derivatives
/// by time.
#[derive(Clone, Copy)]
pub(crate) struct Point<'a> {
    /// Time.
    pub(crate) time: f64,
    /// Derivatives of the time; empty for an instant that does not move.
    pub(crate) moving: &'a [f64],
    /// Unknowns.
    pub(crate) y: &'a [f64],
    /// Their derivatives by time.
    pub(crate) yp: &'a [f64],
}

impl Tangents {
    /// For so many directions.
    pub(crate) fn new(system: &CompiledSystem, width: usize) -> Self {
        let (n, cells) = (system.model().unknowns(), system.memory().all().len());
        let chunk = || Chunk { y: vec![STILL; n], yp: vec![STILL; n], work: vec![STILL; cells], out: Vec::new() };
        Self {
            width,
            chunks: (0..width.div_ceil(LANES)).map(|_| chunk()).collect(),
            y: vec![0.0; n],
            yp: vec![0.0; n],
            memory: vec![0.0; cells],
            out: Vec::new(),
            registers: Vec::new(),
        }
    }

    /// Of nothing.
    pub(crate) fn none() -> Self {
        Self { width: 0, chunks: vec![], y: vec![], yp: vec![], memory: vec![], out: vec![], registers: vec![] }
    }

    /// Rates do not move.
    pub(crate) fn still_rates(&mut self) {
        self.chunks.iter_mut().for_each(|chunk| chunk.yp.fill(STILL));
    }

    /// Sets the derivative of a rate along a direction.
    pub(crate) fn set_yp(&mut self, at: usize, direction: usize, value: f64) {
        self.chunks[direction / LANES].yp[at][direction % LANES] = value;
    }

    /// Nothing moves.
    pub(crate) fn clear(&mut self) {
        for chunk in &mut self.chunks {
            chunk.y.fill(STILL);
            chunk.yp.fill(STILL);
            chunk.work.fill(STILL);
        }
    }

    /// Derivative of an unknown along a direction.
    pub(crate) fn y(&self, at: usize, direction: usize) -> f64 {
        self.chunks[direction / LANES].y[at][direction % LANES]
    }

    /// Sets it.
    pub(crate) fn set_y(&mut self, at: usize, direction: usize, value: f64) {
        self.chunks[direction / LANES].y[at][direction % LANES] = value;
    }

    /// Takes the derivatives of all unknowns along these directions from a matrix, row after row.
    pub(crate) fn take_y(&mut self, rows: &[f64], directions: &[usize]) {
        for (at, row) in rows.chunks_exact(directions.len().max(1)).enumerate() {
            directions.iter().zip(row).for_each(|(&direction, &value)| self.set_y(at, direction, value));
        }
    }

    /// Writes them to a matrix, row after row.
    pub(crate) fn write_y(&self, rows: &mut [f64], directions: &[usize]) {
        for (at, row) in rows.chunks_exact_mut(directions.len().max(1)).enumerate() {
            directions.iter().zip(row).for_each(|(&direction, value)| *value = self.y(at, direction));
        }
    }

    /// Derivative of a number of the workspace along a direction.
    pub(crate) fn work(&self, cell: usize, direction: usize) -> f64 {
        self.chunks[direction / LANES].work[cell][direction % LANES]
    }

    /// Sets it.
    pub(crate) fn set_work(&mut self, cell: usize, direction: usize, value: f64) {
        self.chunks[direction / LANES].work[cell][direction % LANES] = value;
    }

    /// Returns `true` if something in a part of the workspace moves.
    pub(crate) fn is_active(&self, cells: Range<usize>) -> bool {
        self.chunks.iter().any(|chunk| chunk.work[cells.clone()].iter().any(|tangent| *tangent != STILL))
    }

    /// Takes the derivatives of the rates of all unknowns along these directions from a matrix, row
    /// after row.
    pub(crate) fn take_yp(&mut self, rows: &[f64], directions: &[usize]) {
        for (at, row) in rows.chunks_exact(directions.len().max(1)).enumerate() {
            directions.iter().zip(row).for_each(|(&direction, &value)| self.set_yp(at, direction, value));
        }
    }

    /// Takes all derivatives, along the same directions.
    pub(crate) fn copy_all(&mut self, from: &Self) {
        for (to, from) in self.chunks.iter_mut().zip(&from.chunks) {
            to.y.copy_from_slice(&from.y);
            to.yp.copy_from_slice(&from.yp);
            to.work.copy_from_slice(&from.work);
        }
    }

    /// Returns `true` if something moves along a direction.
    pub(crate) fn moves(&self, direction: usize) -> bool {
        let Some(chunk) = self.chunks.get(direction / LANES) else { return false };
        chunk.y.iter().chain(&chunk.work).any(|tangent| tangent[direction % LANES] != 0.0)
    }

    /// Takes the derivatives of a part of the workspace, along the same directions.
    pub(crate) fn copy(&mut self, from: &Self, cells: Range<usize>) {
        let chunks = self.chunks.iter_mut().zip(&from.chunks);
        chunks.for_each(|(to, from)| to.work[cells.clone()].copy_from_slice(&from.work[cells.clone()]));
    }

    /// A part of the workspace does not move.
    pub(crate) fn hold(&mut self, cells: Range<usize>) {
        self.chunks.iter_mut().for_each(|chunk| chunk.work[cells.clone()].fill(STILL));
    }

    /// Keeps the present derivatives as those of another instant, as [`CompiledSystem::keep`] keeps
    /// values.
    pub(crate) fn keep(&mut self, system: &CompiledSystem, instant: fn(FramePart) -> Region) {
        let layout = system.memory().layout();
        let parts =
            [(FramePart::Action, Region::Action), (FramePart::Discrete, Region::Discrete), (FramePart::Disturbance, Region::Disturbance)];
        for chunk in &mut self.chunks {
            chunk.work[layout.range(instant(FramePart::Y))].copy_from_slice(&chunk.y);
            for (part, present) in parts {
                let to = layout.range(instant(part)).start;
                chunk.work.copy_within(layout.range(present), to);
            }
        }
    }

    /// Runs a part with derivatives; values stay what they are.
    ///
    /// # Errors
    /// In words, if the part cannot be made.
    pub(crate) fn run(&mut self, system: &CompiledSystem, part: TangentProgram, point: Point<'_>, outputs: usize) -> Result<(), String> {
        let Self { chunks, y, yp, memory, out, registers, .. } = self;
        out.resize(outputs, 0.0);
        for (number, chunk) in chunks.iter_mut().enumerate() {
            y.copy_from_slice(point.y);
            yp.copy_from_slice(point.yp);
            memory.copy_from_slice(system.memory().all());
            chunk.out.resize(outputs, STILL);
            let first = number * LANES;
            let moving = std::array::from_fn(|lane| point.moving.get(first + lane).copied().unwrap_or(0.0));
            let mut view = TangentView {
                time: (point.time, moving),
                y: (y, &mut chunk.y),
                yp: (yp, &chunk.yp),
                work: (memory, &mut chunk.work),
                out: (out, &mut chunk.out),
                tables: &[],
                registers,
            };
            system.model().tangent(part, &mut view).map_err(ToString::to_string)?;
        }
        Ok(())
    }

    /// An output of the last run.
    pub(crate) fn value(&self, at: usize) -> f64 {
        self.out[at]
    }

    /// Derivative of an output of the last run.
    pub(crate) fn output(&self, at: usize, direction: usize) -> f64 {
        self.chunks[direction / LANES].out[at][direction % LANES]
    }

    /// Number of directions.
    pub(crate) fn width(&self) -> usize {
        self.width
    }
}
