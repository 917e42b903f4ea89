//! The models of this repository through the back end: compiled residuals against interpreted equations, Jacobians against differences
//! along random directions.

use std::path::Path;

use smpl_compiler::compile::flatten;
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_compiler::interpret::{Tape, View};
use smpl_compiler::ir::{Affine, Nest, Program, Store, Target};
use smpl_compiler::layout::Memory;
use smpl_compiler::schedule::{Access, Staged};
use smpl_dsl::diagnostic::SourceMap;

fn compile(name: &str) -> CompiledModel {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let text = std::fs::read_to_string(folder.join(name)).expect("the model file");
    let mut sources = SourceMap::default();
    let main = sources.add(name, text);
    let mut loader = |path: &str| Some((path.to_owned(), std::fs::read_to_string(folder.join(path)).ok()?));
    let (model, _) = flatten(&mut sources, main, &mut loader, &Options::default()).expect("a correct model");
    CompiledModel::build(model, &BackEndSettings::default()).expect("the model compiles")
}

/// A reproducible stream of numbers in (0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }
}

/// Near the initial state, unknowns that have none near 1/2.
fn point(model: &CompiledModel, random: &mut Random) -> (Memory, Vec<f64>, Vec<f64>) {
    let mut m = model.memory();
    let mut y = vec![0.5; model.unknowns()];
    model.parameters(&mut m);
    model.prepare_parameters(&mut m);
    model.initial_states(&mut m, &mut y);
    model.initial_discretes(&mut m, &mut y);
    y.iter_mut().for_each(|y| *y = *y * (0.9 + 0.2 * random.next()) + 1e-3 * random.next());
    model.prepare_step(&mut m);
    let yp = y.iter().map(|y| y * (random.next() - 0.5)).collect();
    (m, y, yp)
}

/// The equations as they were given, interpreted.
fn interpreted(model: &CompiledModel, m: &mut Memory, t: f64, y: &[f64], yp: &[f64]) -> Vec<f64> {
    let flat = model.model();
    let nests = flat.rows.iter().map(|row| {
        let first = model.offset(row.var).expect("an unknown") as i64;
        let target = Target::out(row.at.plus(Affine::constant(first)));
        Nest::over(row.extents.iter().copied(), vec![Store { target, value: row.residual }])
    });
    let staged = Staged { stages: vec![nests.collect()], in_place: false };
    let access = Access { name: "rows", y: true, yp: true, out: y.len() };
    let tape = Tape::new(&staged, &flat.exprs, model.layout(), access).expect("a tape");
    let mut out = vec![f64::NAN; y.len()];
    let work = m.all_mut();
    tape.run(&mut View { time: t, factor: 0.0, y: &mut y.to_vec(), yp, work, out: &mut out, tables: &[] });
    out
}

fn close(a: f64, b: f64, scale: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= scale
}

fn check_residual(model: &CompiledModel, name: &str) {
    let mut random = Random(7);
    for _ in 0..3 {
        let (mut m, y, yp) = point(model, &mut random);
        let mut out = vec![f64::NAN; y.len()];
        model.residual(&mut m, 0.7, &y, &yp, &mut out);
        let expected = interpreted(model, &mut m, 0.7, &y, &yp);
        for (i, (a, b)) in out.iter().zip(&expected).enumerate() {
            assert!(close(*a, *b, 1e-13 * b.abs().max(1e-6)), "{name}: row {i} is {a}, interpreted {b}");
        }
    }
}

/// `J v` and `Σ |J v|` by rows.
fn product(model: &CompiledModel, values: &[f64], v: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut sums, mut sizes) = (vec![0.0; v.len()], vec![0.0; v.len()]);
    let pattern = model.pattern();
    for (column, x) in v.iter().enumerate() {
        for k in pattern.column_pointers[column]..pattern.column_pointers[column + 1] {
            sums[pattern.row_indices[k]] += values[k] * x;
            sizes[pattern.row_indices[k]] += (values[k] * x).abs();
        }
    }
    (sums, sizes)
}

fn check_jacobian(model: &CompiledModel, name: &str) {
    let (mut random, cj) = (Random(3), 2.5);
    let (mut m, y, yp) = point(model, &mut random);
    let mut values = vec![f64::NAN; model.pattern().nonzeros()];
    model.jacobian(&mut m, 0.7, &y, &yp, cj, &mut values);
    for _ in 0..4 {
        let v: Vec<f64> = y.iter().map(|y| (random.next() - 0.5) * y.abs().max(1e-4)).collect();
        let h = 1e-5;
        let mut moved = |h: f64| {
            let shift = |x: &[f64], factor: f64| x.iter().zip(&v).map(|(x, v)| x + h * factor * v).collect::<Vec<_>>();
            let mut out = vec![0.0; y.len()];
            model.residual(&mut m, 0.7, &shift(&y, 1.0), &shift(&yp, cj), &mut out);
            out
        };
        let (up, down) = (moved(h), moved(-h));
        let (sums, sizes) = product(model, &values, &v);
        for row in 0..y.len() {
            let expected = (up[row] - down[row]) / (2.0 * h);
            let tolerance = 2e-6 * sizes[row] + 1e-9 * up[row].abs() + 1e-9;
            assert!(close(sums[row], expected, tolerance), "{name}: row {row} is {}, by differences {expected}", sums[row]);
        }
    }
}

/// Programs as they were given, interpreted, leave the same numbers behind as the compiled ones.
fn check_programs(model: &CompiledModel, name: &str) {
    let programs = &model.model().programs;
    let tape = |program: &Program, out| {
        let access = Access { name: "program", y: true, yp: true, out };
        Tape::new(&Staged::of_program(program), &model.model().exprs, model.layout(), access).expect("a tape")
    };
    let outputs = model.interface().quantities.algebraics.iter().map(smpl_compiler::model::Quantity::len).sum();
    let mut random = Random(5);
    for _ in 0..3 {
        let (m, y, yp) = point(model, &mut random);
        for (which, program, out) in [
            ("start", &programs.start, 0),
            ("end", &programs.end, 0),
            ("disturb", &programs.disturb, 0),
            ("finish", &programs.finish, model.finish_len()),
            ("outputs", &programs.outputs, outputs),
        ] {
            let (mut m1, mut y1, mut out1) = (m.clone(), y.clone(), vec![0.0; out]);
            let (mut m2, mut y2, mut out2) = (m.clone(), y.clone(), vec![0.0; out]);
            match which {
                "start" => model.start(&mut m1, 0.7, &mut y1),
                "end" => model.end(&mut m1, 0.7, &mut y1),
                "disturb" => model.disturb(&mut m1, 0.7),
                "finish" => model.finish(&mut m1, 0.7, &y1, &yp, &mut out1),
                _ => model.outputs(&mut m1, 0.7, &y1, &yp, &mut out1),
            }
            let work = m2.all_mut();
            tape(program, out).run(&mut View { time: 0.7, factor: 0.0, y: &mut y2, yp: &yp, work, out: &mut out2, tables: &[] });
            // Columns at the end of the workspace are working memory of compiled code.
            let used = model.layout().columns() as usize;
            let compiled = y1.iter().chain(&out1).chain(&m1.all()[..used]);
            let interpreted = y2.iter().chain(&out2).chain(&m2.all()[..used]);
            for (i, (a, b)) in compiled.zip(interpreted).enumerate() {
                assert!(close(*a, *b, 1e-13 * b.abs().max(1e-9)), "{name}, {which}: number {i} is {a}, interpreted {b}");
            }
        }
    }
}

fn check(name: &str) {
    let model = compile(name);
    check_residual(&model, name);
    check_jacobian(&model, name);
    check_programs(&model, name);
}

#[test]
fn reactor_is_compiled_right() {
    check("reactor.eq");
}

#[test]
fn beer_is_compiled_right() {
    check("beer.eq");
}

#[test]
fn atropine_is_compiled_right() {
    check("atropine.eq");
}

#[test]
fn mab_is_compiled_right() {
    check("mab.eq");
}

#[test]
fn pensim_is_compiled_right() {
    check("pensim.eq");
}
