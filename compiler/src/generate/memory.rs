//! Loads and stores, and the pointers that they share.

use cranelift_codegen::ir::{Endianness, InstBuilder, MemFlagsData, Value, types};

use super::emitter::{Emitter, Lanes, Start, WORD};
use crate::ir::{Affine, Expr, ExprId, FastSet, Flavour, MAX_DEPTH, Place, Store, Target};
use crate::kernels::KernelTable;
use crate::layout::Base;
use crate::schedule::{BlockId, Item};

/// Pointer and offset of a place ahead of the columns or after them.
pub(super) fn slot_pointer(emitter: &mut Emitter<'_>, slot: u32) -> (Value, i32) {
    pointer_to(emitter, 0, Base::Work, Affine::constant(i64::from(emitter.input.layout.columns() + slot)))
}

/// Writes a value to its place in memory.
pub(super) fn write_slot(emitter: &mut Emitter<'_>, slot: u32, value: Value) {
    let (pointer, offset) = slot_pointer(emitter, slot);
    emitter.b.ins().store(MemFlagsData::new().with_notrap().with_aligned(), value, pointer, offset);
}

/// Reads a value of a block from its place in memory.
pub(super) fn read_slot(emitter: &mut Emitter<'_>, block: BlockId, slot: u32, expr: ExprId) -> Value {
    let (pointer, offset) = slot_pointer(emitter, slot);
    let kind = match (emitter.is_two(block), emitter.input.exprs.is_truth(expr)) {
        (true, false) => types::F64X2,
        (true, true) => types::I64X2,
        (false, false) => types::F64,
        (false, true) => types::I8,
    };
    emitter.b.ins().load(kind, MemFlagsData::new().with_notrap().with_aligned(), pointer, offset)
}

/// Properties of loads: in place, memory changes under the function.
pub(super) fn flags(emitter: &Emitter<'_>, two: bool) -> MemFlagsData {
    let flags = MemFlagsData::new().with_notrap();
    let flags = if emitter.input.in_place { flags } else { flags.with_readonly().with_can_move() };
    if two { flags } else { flags.with_aligned() }
}

pub(super) fn load(emitter: &mut Emitter<'_>, block: BlockId, base: Base, at: Affine) -> Value {
    let two = emitter.is_two(block);
    let flags = if block == 0 && emitter.input.segments.is_active() {
        MemFlagsData::new().with_notrap().with_aligned()
    } else {
        flags(emitter, two)
    };
    let (pointer, offset) = pointer_to(emitter, block, base, at);
    if !two {
        return emitter.b.ins().load(types::F64, flags, pointer, offset);
    }
    match lane_stride(emitter, block, at) {
        1 => emitter.b.ins().load(types::F64X2, flags, pointer, offset),
        0 => {
            let one = emitter.b.ins().load(types::F64, flags, pointer, offset);
            emitter.b.ins().splat(types::F64X2, one)
        }
        stride => {
            let first = emitter.b.ins().load(types::F64, flags, pointer, offset);
            let (pointer, offset) = pointer_to(emitter, block, base, at.plus(Affine::constant(stride)));
            let second = emitter.b.ins().load(types::F64, flags, pointer, offset);
            let both = emitter.b.ins().splat(types::F64X2, first);
            emitter.b.ins().insertlane(both, second, 1u8)
        }
    }
}

/// Stride of an address that is used in a block along the lanes; a reduction there may bind the
/// counter of the lanes again.
fn lane_stride(emitter: &Emitter<'_>, block: BlockId, at: Affine) -> i64 {
    let Lanes::Two(outer) = emitter.lanes else {
        return 0;
    };
    let counter = emitter.input.schedule.blocks[outer].counter.filter(|&c| emitter.input.schedule.binder(block, c) == Some(outer));
    counter.map_or(0, |c| at.strides[c as usize])
}

/// Pointer and constant offset in bytes of an element of 8 bytes.
pub(super) fn pointer_to(emitter: &mut Emitter<'_>, block: BlockId, base: Base, at: Affine) -> (Value, i32) {
    let mut pointer = advanced(emitter, block, Start::Memory(base), at.strides);
    let bytes = at.offset * WORD;
    let offset = i32::try_from(bytes).unwrap_or_else(|_| {
        pointer = emitter.b.ins().iadd_imm_s(pointer, bytes);
        0
    });
    (pointer, offset)
}

/// `start + size · Σ strides·counters`: what the outer loops add to it, then this one.
fn advanced(emitter: &mut Emitter<'_>, block: BlockId, start: Start, mut strides: [i64; MAX_DEPTH]) -> Value {
    if let Some(&known) = emitter.pointers[block].get(&(start, strides)) {
        return known;
    }
    let key = (start, strides);
    let here = &emitter.input.schedule.blocks[block];
    let step = here.counter.map_or(0, |c| std::mem::take(&mut strides[c as usize]));
    let mut pointer = match here.parent {
        Some(parent) => advanced(emitter, parent, start, strides),
        None => start_of(emitter, start),
    };
    if let Some(counter) = emitter.counters[block].filter(|_| step != 0) {
        let bytes = step * start.size();
        let distance = if bytes > 0 && bytes.count_ones() == 1 {
            emitter.b.ins().ishl_imm_u(counter, i64::from(bytes.trailing_zeros()))
        } else {
            emitter.b.ins().imul_imm_s(counter, bytes)
        };
        pointer = emitter.b.ins().iadd(pointer, distance);
    }
    emitter.pointers[block].insert(key, pointer);
    pointer
}

fn start_of(emitter: &mut Emitter<'_>, start: Start) -> Value {
    match start {
        Start::Memory(Base::Y) => emitter.input.arguments.y,
        Start::Memory(Base::Yp) => emitter.input.arguments.yp,
        Start::Memory(Base::Work | Base::Factor) => emitter.input.arguments.work,
        Start::Memory(Base::Out) => emitter.input.arguments.out,
        Start::Tables => {
            let tables_at = (std::mem::size_of::<KernelTable>()) as i32;
            emitter.b.ins().load(types::I64, constant_memory(), emitter.input.arguments.surroundings, tables_at)
        }
    }
}

/// Makes the parts of pointers that a loop does not change ahead of it.
pub(super) fn prepare_pointers(emitter: &mut Emitter<'_>, child: BlockId) {
    let (schedule, exprs, layout) = (emitter.input.schedule, emitter.input.exprs, emitter.input.layout);
    let here = &schedule.blocks[child];
    let Some(parent) = here.parent else { return };
    let mut wanted = FastSet::default();
    let mut want = |start: Start, at: Affine| {
        let mut strides = at.strides;
        here.counter.iter().for_each(|&c| strides[c as usize] = 0);
        wanted.insert((start, strides));
    };
    for item in &here.items {
        match *item {
            Item::Eval(expr) => {
                if let Expr::Load { var, flavour, at } = exprs.node(expr)
                    && let Some(a) = layout.address(var, flavour)
                {
                    want(Start::Memory(a.base), at);
                }
            }
            Item::Store(Store { target: Target { place: Place::Out, at }, .. }) => want(Start::Memory(Base::Out), at),
            Item::Store(Store { target: Target { place: Place::Table { plus, .. }, at: index }, .. }) => {
                want(Start::Tables, index);
                want(Start::Memory(Base::Out), plus);
            }
            Item::Store(Store { target: Target { place: Place::Var(_), .. }, .. }) | Item::Reduce { .. } => {}
        }
    }
    let mut wanted: Vec<_> = wanted.into_iter().collect();
    wanted.sort_unstable();
    for (start, strides) in wanted {
        advanced(emitter, parent, start, strides);
    }
}

/// Stores a number.
pub(super) fn store(emitter: &mut Emitter<'_>, block: BlockId, Target { place, at }: Target, value: Value) {
    match place {
        Place::Out => store_at(emitter, block, Base::Out, at, value),
        Place::Var(var) => {
            if let Some(a) = emitter.input.layout.address(var, Flavour::Value) {
                store_at(emitter, block, a.base, at.plus(Affine::constant(i64::from(a.offset))), value);
            }
        }
        Place::Table { table, plus, add } => {
            let index = at.plus(Affine::constant(i64::from(table)));
            if !emitter.is_two(block) {
                store_slot(emitter, block, index, plus, add, value);
                return;
            }
            for lane in [0u8, 1] {
                let step = |at: Affine, stride: i64| at.plus(Affine::constant(stride * i64::from(lane)));
                let number = lane_of(emitter, value, lane, add);
                let (index, plus) = (step(index, lane_stride(emitter, block, index)), step(plus, lane_stride(emitter, block, plus)));
                store_slot(emitter, block, index, plus, add, number);
            }
        }
    }
}

fn store_at(emitter: &mut Emitter<'_>, block: BlockId, base: Base, at: Affine, value: Value) {
    let flags = MemFlagsData::new().with_notrap();
    let (pointer, offset) = pointer_to(emitter, block, base, at);
    if !emitter.is_two(block) || lane_stride(emitter, block, at) == 1 {
        emitter.b.ins().store(flags, value, pointer, offset);
        return;
    }
    let stride = lane_stride(emitter, block, at);
    for lane in [0u8, 1] {
        let (pointer, offset) = pointer_to(emitter, block, base, at.plus(Affine::constant(stride * i64::from(lane))));
        let number = lane_of(emitter, value, lane, false);
        emitter.b.ins().store(flags, number, pointer, offset);
    }
}

/// One of two numbers, to be stored or to be `added` to; the second is stored fastest as the bits
/// it is.
fn lane_of(emitter: &mut Emitter<'_>, value: Value, lane: u8, added: bool) -> Value {
    let value = if lane == 1 && !added { emitter.b.ins().bitcast(types::I64X2, little(), value) } else { value };
    emitter.b.ins().extractlane(value, lane)
}

/// Stores at `tables[index] + plus` of the output, or adds there.
fn store_slot(emitter: &mut Emitter<'_>, block: BlockId, index: Affine, plus: Affine, add: bool, value: Value) {
    let mut entry = advanced(emitter, block, Start::Tables, index.strides);
    let at = i32::try_from(index.offset * 4).unwrap_or_else(|_| {
        entry = emitter.b.ins().iadd_imm_s(entry, index.offset * 4);
        0
    });
    let slot = emitter.b.ins().uload32(constant_memory(), entry, at);
    let (pointer, offset) = pointer_to(emitter, block, Base::Out, plus);
    let bytes = emitter.b.ins().ishl_imm_u(slot, 3);
    let pointer = emitter.b.ins().iadd(pointer, bytes);
    let flags = MemFlagsData::new().with_notrap();
    let value = if add {
        let old = emitter.b.ins().load(types::F64, flags, pointer, offset);
        emitter.b.ins().fadd(old, value)
    } else {
        value
    };
    emitter.b.ins().store(flags, value, pointer, offset);
}

/// Lanes in the order of memory.
fn little() -> MemFlagsData {
    MemFlagsData::new().with_endianness(Endianness::Little)
}

/// Memory that never changes.
pub(super) fn constant_memory() -> MemFlagsData {
    MemFlagsData::new().with_notrap().with_readonly().with_can_move()
}
