//! The state of a function that is being written, and its numbers in one lane or two.

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{Constant, ConstantData, InstBuilder, MemFlagsData, SigRef, Type, Value, types};
use cranelift_frontend::FunctionBuilder;

use super::residence::WideResidence;
use super::segments::Segments;
use crate::ir::{ExprId, Exprs, FastMap, MAX_DEPTH};
use crate::layout::{Base, Layout};
use crate::schedule::{BlockId, Schedule};

/// Bytes of a number, a pointer.
pub(super) const WORD: i64 = 8;

/// Columns of working memory start at cache lines.
pub(super) const LINE: u32 = 8;

/// Base of a pointer.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Start {
    /// Memory of numbers.
    Memory(Base),
    /// The position tables.
    Tables,
}

impl Start {
    /// Bytes of an element.
    pub(super) fn size(self) -> i64 {
        match self {
            Start::Memory(_) => WORD,
            Start::Tables => 4,
        }
    }
}

/// Arguments of the function.
#[derive(Clone, Copy)]
pub(super) struct Arguments {
    pub(super) time: Value,
    pub(super) factor: Value,
    pub(super) y: Value,
    pub(super) yp: Value,
    pub(super) work: Value,
    pub(super) out: Value,
    pub(super) surroundings: Value,
}

/// Lanes of the code that is being written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Lanes {
    /// One number.
    One,
    /// Two neighbours along the counter of the block.
    Two(BlockId),
}

/// Function being written, and the places of its operands.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub(super) exprs: &'a Exprs,
    pub(super) layout: &'a Layout,
    pub(super) schedule: &'a Schedule,
    /// Segments of the code outside of loops.
    pub(super) segments: &'a Segments,
    pub(super) arguments: Arguments,
    /// The code is long.
    pub(super) lean: bool,
    /// The function stores into what it reads.
    pub(super) in_place: bool,
    /// Rounding is an instruction.
    pub(super) rounding: bool,
}

/// Writes one function.
pub(super) struct Emitter<'a> {
    pub(super) b: FunctionBuilder<'a>,
    pub(super) input: Input<'a>,
    pub(super) lanes: Lanes,
    /// Values by block; those of a block are forgotten when its code ends.
    pub(super) values: Vec<FastMap<ExprId, Value>>,
    /// Two equal lanes of values from outside of the loop of lanes.
    pub(super) splats: FastMap<(BlockId, ExprId), Value>,
    /// Loop counters by block.
    pub(super) counters: Vec<Option<Value>>,
    /// Pointers by block: memory and strides that they already contain.
    pub(super) pointers: Vec<FastMap<(Start, [i64; MAX_DEPTH]), Value>>,
    pub(super) signatures: FastMap<(usize, bool), SigRef>,
    /// Numbers in both lanes, by their bits.
    pub(super) constants: FastMap<u64, Constant>,
    /// Places of the values of the loop of lanes, if it is long.
    pub(super) wide: Option<WideResidence>,
    /// Numbers of working memory used.
    pub(super) columns: u32,
}

impl<'a> Emitter<'a> {
    /// Begins to write; nothing has a value yet.
    pub(super) fn new(b: FunctionBuilder<'a>, input: Input<'a>) -> Self {
        let blocks = input.schedule.blocks.len();
        let mut emitter = Emitter {
            b,
            input,
            lanes: Lanes::One,
            values: vec![FastMap::default(); blocks],
            splats: FastMap::default(),
            counters: vec![None; blocks],
            pointers: vec![FastMap::default(); blocks],
            signatures: FastMap::default(),
            constants: FastMap::default(),
            wide: None,
            columns: 0,
        };
        emitter.columns = emitter.reserved();
        emitter
    }
}

impl Emitter<'_> {
    /// Numbers of working memory ahead of the columns: those of [`Segments`].
    pub(super) fn reserved(&self) -> u32 {
        self.input.segments.len().next_multiple_of(LINE)
    }

    /// The type of numbers in a block.
    pub(super) fn number_type(&self, block: BlockId) -> Type {
        if self.is_two(block) { types::F64X2 } else { types::F64 }
    }

    /// Returns `true` if values of a block have two lanes.
    pub(super) fn is_two(&self, block: BlockId) -> bool {
        match self.lanes {
            Lanes::One => false,
            Lanes::Two(outer) => self.input.schedule.is_inside(block, outer),
        }
    }

    /// The loop of lanes that is being written.
    pub(super) fn wide_block(&self) -> BlockId {
        self.wide.as_ref().map_or(0, |wide| wide.block)
    }

    /// A constant in the lanes of a block.
    pub(super) fn number(&mut self, block: BlockId, x: f64) -> Value {
        if !self.is_two(block) {
            return self.b.ins().f64const(x);
        }
        self.two_numbers(x)
    }

    /// A constant in the lanes of a block, to be held in a register. Long code, which skips the
    /// mid-end, reads it from memory, since it would otherwise pass through an integer register.
    pub(super) fn held_number(&mut self, block: BlockId, x: f64) -> Value {
        if self.is_two(block) || !self.input.lean || !cfg!(target_arch = "x86_64") || x.to_bits() == 0 {
            return self.number(block, x);
        }
        let both = self.two_numbers(x);
        self.b.ins().extractlane(both, 0u8)
    }

    pub(super) fn two_numbers(&mut self, x: f64) -> Value {
        let func = &mut self.b.func;
        let both = *self.constants.entry(x.to_bits()).or_insert_with(|| {
            let bytes = x.to_le_bytes();
            let both: ConstantData = bytes.into_iter().chain(bytes).collect();
            func.dfg.constants.insert(both)
        });
        self.b.ins().vconst(types::F64X2, both)
    }

    /// `-a`
    pub(super) fn negative(&mut self, block: BlockId, a: Value) -> Value {
        if !self.input.lean || !cfg!(target_arch = "x86_64") {
            return self.b.ins().fneg(a);
        }
        let sign = self.held_number(block, -0.0);
        self.b.ins().bxor(a, sign)
    }

    pub(super) fn select(&mut self, two: bool, c: Value, a: Value, b: Value) -> Value {
        if !two {
            return self.b.ins().select(c, a, b);
        }
        let mask = self.b.ins().bitcast(types::F64X2, MemFlagsData::new(), c);
        self.b.ins().bitselect(mask, a, b)
    }

    /// `a` where it is NaN or less than `b`, else `b`.
    pub(super) fn least(&mut self, a: Value, b: Value) -> Value {
        let two = self.b.func.dfg.value_type(a) == types::F64X2;
        // A choice between two values by `<` of the same values is one instruction, also in lanes.
        let less = self.b.ins().fcmp(FloatCC::LessThan, a, b);
        let least = self.select(two, less, a, b);
        self.unless_nan(two, a, least)
    }

    /// `a` where it is NaN or more than `b`, else `b`.
    pub(super) fn most(&mut self, a: Value, b: Value) -> Value {
        let two = self.b.func.dfg.value_type(a) == types::F64X2;
        let less = self.b.ins().fcmp(FloatCC::LessThan, b, a);
        let most = self.select(two, less, a, b);
        self.unless_nan(two, a, most)
    }

    /// `b` unless `a` is NaN.
    fn unless_nan(&mut self, two: bool, a: Value, b: Value) -> Value {
        let nan = self.b.ins().fcmp(FloatCC::Unordered, a, a);
        self.select(two, nan, a, b)
    }
}
