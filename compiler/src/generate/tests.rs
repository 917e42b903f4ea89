//! Compiled code against the interpreter on random programs: the same bits.

use std::sync::Arc;

use proptest::prelude::*;
use smpl_dsl::span::Span;

use super::{Code, CompiledFn, Effort, Executable, Generator, Surroundings, plan};
use crate::interpret::{Tape, View};
use crate::ir::{Affine, BinaryFn, Compare, ExprId, Flavour, LoopVar, MAX_DEPTH, Nest, ReduceFn, Role, Store, Target, UnaryFn, VarId};
use crate::kernels;
use crate::layout::{Layout, Memory};
use crate::model::{Model, Variable};
use crate::schedule::{Access, Staged};

/// Elements of each array: enough for every address that is made below.
const LEN: u32 = 64;
/// Passes of a loop or a reduction.
const MOST_PASSES: u32 = 7;

/// Choices that one node is made of.
type Recipe = (u8, u16, u16, u16, f64);

struct World {
    model: Model,
    state: VarId,
    discrete: VarId,
    numbers: Vec<ExprId>,
    truths: Vec<ExprId>,
}

impl World {
    fn new() -> World {
        let mut model = Model::default();
        let mut variable = |name: &str, role, len| model.vars.push(Variable { name: name.into(), role, len, span: Span::default() });
        let state = variable("x", Role::State, LEN);
        let discrete = variable("d", Role::Discrete, LEN);
        model.unknowns.push(state);
        World { model, state, discrete, numbers: vec![], truths: vec![] }
    }

    /// Adds the node of a recipe; `depth` counters are bound.
    fn add(&mut self, (kind, i, j, k, x): Recipe, depth: usize) {
        let number = |n: u16| self.numbers.get(usize::from(n) % self.numbers.len().max(1)).copied();
        let truth = |n: u16| self.truths.get(usize::from(n) % self.truths.len().max(1)).copied();
        let e = &mut self.model.exprs;
        let (Some(a), Some(b)) = (number(i), number(j)) else {
            self.numbers.push(e.constant(x));
            return;
        };
        let made = match kind % 16 {
            0 => e.constant(x),
            1 | 2 => {
                let var = if i % 2 == 0 { self.state } else { self.discrete };
                let flavour = if kind % 2 == 0 && i % 2 == 0 { Flavour::Derivative } else { Flavour::Value };
                e.load(var, flavour, address(depth, j, k))
            }
            3 if depth > 0 => e.counter(LoopVar((usize::from(i) % depth) as u8)),
            4 => e.time(),
            5 | 6 => {
                let all = UnaryFn::ALL;
                e.unary(all[usize::from(k) % all.len()], a)
            }
            7..=9 => {
                let all = [
                    BinaryFn::Add,
                    BinaryFn::Sub,
                    BinaryFn::Mul,
                    BinaryFn::Div,
                    BinaryFn::Pow,
                    BinaryFn::Min,
                    BinaryFn::Max,
                    BinaryFn::Atan2,
                ];
                e.binary(all[usize::from(k) % all.len()], a, b)
            }
            10 => e.powi(a, i32::from(k % 13) - 6),
            11 => {
                let op = [Compare::Lt, Compare::Le, Compare::Eq, Compare::Ne][usize::from(k) % 4];
                let made = e.compare(op, a, b);
                self.truths.push(made);
                return;
            }
            12 => {
                let (Some(p), Some(q)) = (truth(i), truth(j)) else { return };
                let made = match k % 3 {
                    0 => e.and(p, q),
                    1 => e.or(p, q),
                    _ => e.not(p),
                };
                self.truths.push(made);
                return;
            }
            13 | 14 => {
                let Some(c) = truth(k) else { return };
                e.select(c, a, b)
            }
            _ => {
                // A reduction may bind a new counter or one that the nest uses outside of it.
                let d = usize::from(j) % (depth + 1).min(MAX_DEPTH);
                let op = [ReduceFn::Sum, ReduceFn::Product, ReduceFn::Min, ReduceFn::Max][usize::from(k) % 4];
                let load = e.load(self.state, Flavour::Value, address(d + 1, i, k));
                let body = e.add(load, a);
                e.reduce(op, LoopVar(d as u8), u32::from(k % 5), body)
            }
        };
        self.numbers.push(made);
    }
}

/// An address within [`LEN`] for counters below [`MOST_PASSES`].
fn address(depth: usize, j: u16, k: u16) -> Affine {
    let mut at = Affine::constant(i64::from(k % 8) + 24);
    for d in 0..depth.min(MAX_DEPTH) {
        at.strides[d] = [0, 1, 1, 2, -1][usize::from(j >> (3 * d)) % 5];
    }
    at
}

/// Runs a staged program compiled and interpreted on the same numbers: (y, workspace, out) of both.
fn run_both(world: &World, staged: &Staged, effort: Effort, out: usize, numbers: &[f64]) -> [Vec<Vec<f64>>; 2] {
    let access = Access { name: "test", y: true, yp: true, out };
    let exprs = &world.model.exprs;
    let layout = Layout::new(&world.model, 0);
    let plan = plan(staged, exprs, &layout, access).unwrap_or_else(|e| panic!("{e} for {staged:?} of {exprs:?}"));
    let mut generator = Generator::new(false);
    let codes = plan.pieces().iter().map(|piece| generator.compile(&plan, piece, exprs, &layout, "test", effort));
    let codes: Vec<Code> = codes.collect::<Result<_, _>>().unwrap_or_else(|e| panic!("{e} for {staged:?} of {exprs:?}"));
    let columns = codes.iter().map(|c| c.columns).max().unwrap_or(0);
    let layout = Arc::new(Layout::new(&world.model, columns));
    let tape = Tape::new(staged, exprs, &layout, access).expect("tape");
    let executable = Executable::new(&codes.iter().map(|c| c.bytes.as_slice()).collect::<Vec<_>>()).expect("memory");
    let surroundings = Surroundings { kernels: *kernels::table(), tables: std::ptr::null(), lists: exprs.lists().all().as_ptr() };
    [true, false].map(|compiled| {
        let mut memory = Memory::new(Arc::clone(&layout));
        let columns = layout.columns() as usize;
        memory.all_mut()[..columns].iter_mut().zip(numbers.iter().cycle()).for_each(|(m, x)| *m = *x);
        let mut y = numbers[..LEN as usize].to_vec();
        let yp: Vec<f64> = numbers.iter().rev().take(LEN as usize).copied().collect();
        let mut out = vec![0.0; out];
        if !compiled {
            let (work, out) = (memory.all_mut(), &mut out[..]);
            tape.run(&mut View { time: 1.5, factor: 0.0, y: &mut y, yp: &yp, work, out, tables: &[] });
        }
        for address in (0..codes.len()).filter(|_| compiled).filter_map(|piece| executable.address(piece)) {
            // SAFETY: generated with this signature and for vectors of these lengths.
            unsafe {
                let function = std::mem::transmute::<*const u8, CompiledFn>(address);
                let work = memory.all_mut().as_mut_ptr();
                function(1.5, 0.0, y.as_mut_ptr(), yp.as_ptr(), work, out.as_mut_ptr(), &raw const surroundings);
            }
        }
        vec![y, memory.all()[..columns].to_vec(), out]
    })
}

fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

fn recipes() -> impl Strategy<Value = Vec<Recipe>> {
    let number = prop_oneof![-3.0..3.0, Just(0.0), Just(1.0), Just(-1.0), Just(f64::NAN), Just(f64::INFINITY), 1e-9..1e9];
    prop::collection::vec((any::<u8>(), any::<u16>(), any::<u16>(), any::<u16>(), number), 5..60)
}

fn numbers() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(prop_oneof![8 => -2.0..2.0, 2 => 0.5..300.0, 1 => Just(0.0)], LEN as usize..LEN as usize + 1)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn programs_give_the_bits_of_the_interpreter(
        recipes in recipes(), numbers in numbers(), extents in prop::collection::vec(1u32..=MOST_PASSES, 0..3), hot in any::<bool>(),
    ) {
        let mut world = World::new();
        recipes.into_iter().for_each(|r| world.add(r, extents.len()));
        let loops: Vec<(u8, u32)> = (0..).zip(extents).collect();
        let size: u32 = loops.iter().map(|l| l.1).product();
        let place = |i: usize| {
            let mut at = crate::schedule::row_major(&loops);
            at.offset = (i * size as usize) as i64;
            Target::out(at)
        };
        let values: Vec<ExprId> = world.numbers.iter().chain(&world.truths).copied().rev().take(6).collect();
        let stores = values.iter().enumerate().map(|(i, v)| Store { target: place(i), value: *v }).collect();
        let staged = Staged { stages: vec![vec![Nest { loops: loops.clone(), stores }]], in_place: false };
        let effort = if hot { Effort::Hot } else { Effort::Lukewarm };
        let [compiled, interpreted] = run_both(&world, &staged, effort, values.len() * size as usize, &numbers);
        for (a, b) in compiled.iter().flatten().zip(interpreted.iter().flatten()) {
            prop_assert!(same(*a, *b), "{a:e} compiled, {b:e} interpreted: {:?}", world.model.exprs);
        }
    }

    #[test]
    fn long_programs_cut_into_segments_give_the_bits_of_the_interpreter(
        recipes in prop::collection::vec(recipes(), 6..20), numbers in numbers(), extent in 1u32..=MOST_PASSES, hot in any::<bool>(),
    ) {
        let mut world = World::new();
        recipes.into_iter().flatten().for_each(|r| world.add(r, 1));
        let (mut scalar, mut looped) = (Nest::default(), Nest { loops: vec![(0, extent)], stores: vec![] });
        let values: Vec<ExprId> = world.numbers.iter().chain(&world.truths).copied().step_by(7).collect();
        let mut next = 0;
        for value in values {
            if world.model.exprs.free(value) == 0 {
                scalar.stores.push(Store { target: Target::out(Affine::constant(next)), value });
                next += 1;
            } else {
                looped.stores.push(Store { target: Target::out(Affine::along(next, LoopVar(0), 1)), value });
                next += i64::from(extent);
            }
        }
        let staged = Staged { stages: vec![vec![scalar, looped]], in_place: false };
        let effort = if hot { Effort::Hot } else { Effort::Lukewarm };
        let [compiled, interpreted] = run_both(&world, &staged, effort, next as usize, &numbers);
        for (a, b) in compiled.iter().flatten().zip(interpreted.iter().flatten()) {
            prop_assert!(same(*a, *b), "{a:e} compiled, {b:e} interpreted");
        }
    }

    #[test]
    fn programs_in_place_give_the_bits_of_the_interpreter(
        recipes in recipes(), numbers in numbers(), extents in prop::collection::vec(1u32..=MOST_PASSES, 0..3), hot in any::<bool>(),
    ) {
        let mut world = World::new();
        recipes.into_iter().for_each(|r| world.add(r, extents.len()));
        let loops: Vec<(u8, u32)> = (0..).zip(extents).collect();
        let values: Vec<ExprId> = world.numbers.iter().copied().rev().take(4).collect();
        let stages = values.chunks(2).map(|pair| {
            let stores = pair.iter().zip([world.state, world.discrete]).enumerate();
            let stores = stores.map(|(i, (v, var))| Store { target: Target::var(var, address(loops.len(), 11 * i as u16, 3)), value: *v });
            vec![Nest { loops: loops.clone(), stores: stores.collect() }]
        });
        let staged = Staged { stages: stages.collect(), in_place: true };
        let effort = if hot { Effort::Hot } else { Effort::Lukewarm };
        let [compiled, interpreted] = run_both(&world, &staged, effort, 0, &numbers);
        for (a, b) in compiled.iter().flatten().zip(interpreted.iter().flatten()) {
            prop_assert!(same(*a, *b), "{a:e} compiled, {b:e} interpreted");
        }
    }
}

/// `Π_i (x[24 + i + j] + Σ_j x[28 + i - j])` over j: the sum binds the counter of the lanes again.
#[test]
fn a_counter_of_lanes_that_a_reduction_binds_again_is_its_own() {
    let mut world = World::new();
    let e = &mut world.model.exprs;
    let address = |offset, strides: [i64; 2]| {
        let mut at = Affine::constant(offset);
        at.strides[..2].copy_from_slice(&strides);
        at
    };
    let inner = e.load(world.state, Flavour::Value, address(28, [1, -1]));
    let sum = e.reduce(ReduceFn::Sum, LoopVar(1), 4, inner);
    let here = e.load(world.state, Flavour::Value, address(24, [1, 1]));
    let term = e.add(sum, here);
    let product = e.reduce(ReduceFn::Product, LoopVar(0), 2, term);
    let nest = Nest { loops: vec![(0, 1), (1, 4)], stores: vec![Store { target: Target::out(address(0, [0, 1])), value: product }] };
    let staged = Staged { stages: vec![vec![nest]], in_place: false };
    let x: Vec<f64> = (0..LEN).map(f64::from).collect();
    let sum = |i: usize| (0..4).map(|j| x[28 + i - j]).sum::<f64>();
    let expected: Vec<f64> = (0..4).map(|j| (x[24 + j] + sum(0)) * (x[25 + j] + sum(1))).collect();
    for effort in [Effort::Hot, Effort::Warm, Effort::Lukewarm] {
        let [compiled, interpreted] = run_both(&world, &staged, effort, 4, &x);
        assert_eq!((&compiled[2], &interpreted[2]), (&expected, &expected));
    }
}

/// The values follow from the definition: the first operand where it is NaN or the smaller (larger)
/// one, else the second.
#[test]
fn extrema_keep_the_bits_of_signed_zeros_and_propagate_nan_in_lanes_and_out_of_them() {
    let special = [f64::NAN, -0.0, 0.0, 1.5, -1.5, f64::INFINITY, f64::NEG_INFINITY];
    let pairs: Vec<(f64, f64)> = special.into_iter().flat_map(|a| special.map(|b| (a, b))).collect();
    // `y'` of the helper is `y` backwards.
    let numbers = |&(a, b): &(f64, f64)| (0..LEN).map(|i| if i < LEN / 2 { a } else { b }).collect::<Vec<f64>>();
    for passes in [1, 4] {
        for f in [BinaryFn::Min, BinaryFn::Max] {
            let mut world = World::new();
            let at = Affine::along(0, LoopVar(0), 1);
            let [a, b] = [Flavour::Value, Flavour::Derivative].map(|flavour| world.model.exprs.load(world.state, flavour, at));
            let value = world.model.exprs.binary(f, a, b);
            let nest = Nest { loops: vec![(0, passes)], stores: vec![Store { target: Target::out(at), value }] };
            let staged = Staged { stages: vec![vec![nest]], in_place: false };
            for pair in &pairs {
                let first = pair.0.is_nan() || if f == BinaryFn::Min { pair.0 < pair.1 } else { pair.0 > pair.1 };
                let expected = if first { pair.0 } else { pair.1 };
                for effort in [Effort::Hot, Effort::Warm, Effort::Lukewarm] {
                    let [compiled, _] = run_both(&world, &staged, effort, passes as usize, &numbers(pair));
                    let right = |x: &f64| x.to_bits() == expected.to_bits() || x.is_nan() && expected.is_nan();
                    assert!(compiled[2].iter().all(right), "{f:?} of {pair:?}: {:?}", compiled[2]);
                }
            }
        }
    }
}

#[test]
fn an_expression_of_a_hundred_thousand_nodes_in_a_chain_is_compiled_and_interpreted() {
    let mut world = World::new();
    let e = &mut world.model.exprs;
    let mut value = e.load(world.state, Flavour::Value, Affine::default());
    for i in 0..100_000 {
        let term = e.constant(f64::from(i % 7) * 1e-3 + 0.1);
        let product = e.mul(value, term);
        value = e.add(product, term);
    }
    let staged = Staged {
        stages: vec![vec![Nest { loops: vec![], stores: vec![Store { target: Target::out(Affine::default()), value }] }]],
        in_place: false,
    };
    let numbers = vec![0.3; LEN as usize];
    let [compiled, interpreted] = run_both(&world, &staged, Effort::Lukewarm, 1, &numbers);
    assert_eq!(compiled[2], interpreted[2]);
}

#[test]
fn an_address_outside_of_its_variable_is_refused() {
    let mut world = World::new();
    let value = world.model.exprs.load(world.state, Flavour::Value, Affine::along(60, LoopVar(0), 1));
    let nest = Nest { loops: vec![(0, 5)], stores: vec![Store { target: Target::out(Affine::along(0, LoopVar(0), 1)), value }] };
    let staged = Staged { stages: vec![vec![nest]], in_place: false };
    let layout = Layout::new(&world.model, 0);
    let access = Access { name: "test", y: true, yp: true, out: 5 };
    assert!(plan(&staged, &world.model.exprs, &layout, access).is_err());
}
