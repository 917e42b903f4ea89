//! Models exported as C compute what the machine code computes, function by function.
//!
//! The C compiler takes the text with all warnings as errors. A program prints the tables of names and then runs every function at the
//! points of its standard input. The vectors are filled by these names alone, so that the tables are tested too.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use smpl_compiler::compiled::CompiledModel;
use smpl_compiler::export::Target;
use smpl_compiler::ir::{Builtin, Role};
use smpl_compiler::layout::{FramePart, Memory, Region};
use smpl_runtime::catalogue::Catalogue;
use smpl_runtime::load::{LoadOptions, Loaded, load};
use smpl_runtime::scenario::Variant;
use smpl_tools::export::export;

const TOLERANCE: f64 = 1e-12;

/// An exported model, compiled with a program that runs it.
struct Program {
    folder: tempfile::TempDir,
    functions: Vec<(String, Vec<String>)>,
    lengths: Lengths,
}

#[derive(Default)]
struct Lengths {
    y: usize,
    u: usize,
    p: usize,
    c: usize,
    nonzeros: usize,
}

impl Program {
    fn new(loaded: &Loaded, effort: &str) -> Program {
        let folder = tempfile::tempdir().expect("a folder");
        let files = export(loaded, Target::C, Some("exported"), None).expect("an export");
        for file in &files {
            std::fs::write(folder.path().join(format!("exported.{}", file.ending)), &file.text).expect("written");
        }
        let header = &files[1].text;
        let lengths = Lengths {
            y: defined(header, "UNKNOWNS"),
            u: defined(header, "ACTIONS"),
            p: defined(header, "PARAMETERS"),
            c: defined(header, "CONTEXT"),
            nonzeros: defined(header, "NONZEROS"),
        };
        let functions = prototypes(header);
        std::fs::write(folder.path().join("main.c"), driver(&functions, &lengths, header)).expect("written");
        let flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", effort, "-o", "run", "main.c", "exported.c", "-lm"];
        let done = Command::new("cc").current_dir(folder.path()).args(flags).output().expect("cc runs");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        Program { folder, functions, lengths }
    }

    fn run(&self, input: &[f64]) -> Vec<u8> {
        let mut command = Command::new(self.folder.path().join("run"));
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it runs");
        let mut stdin = child.stdin.take().expect("a pipe");
        let bytes: Vec<u8> = input.iter().flat_map(|x| x.to_ne_bytes()).collect();
        let writer = std::thread::spawn(move || stdin.write_all(&bytes));
        let output = child.wait_with_output().expect("it ends");
        writer.join().expect("a thread").expect("all is read");
        assert!(output.status.success());
        output.stdout
    }

    /// Names and nominal values of `p` and `c`.
    fn tables(&self) -> [Vec<(String, f64)>; 2] {
        let text = String::from_utf8(self.run(&[])).expect("text");
        let mut tables = [vec![], vec![]];
        for line in text.lines() {
            let (which, rest) = line.split_once(' ').expect("a table");
            let (value, name) = rest.split_once(' ').expect("a value");
            tables[usize::from(which == "c")].push((name.to_owned(), value.parse().unwrap_or(f64::NAN)));
        }
        tables
    }
}

/// A number that a header defines.
fn defined(header: &str, name: &str) -> usize {
    let start = format!("#define EXPORTED_{name} ");
    let line = header.lines().find_map(|line| line.strip_prefix(&start)).expect("defined");
    line.split(' ').next().and_then(|n| n.parse().ok()).expect("a number")
}

/// Names and arguments of the functions of a header.
fn prototypes(header: &str) -> Vec<(String, Vec<String>)> {
    let lines = header.lines().filter_map(|line| line.strip_prefix("void exported_")?.strip_suffix(");"));
    let split = lines.filter_map(|line| line.split_once('('));
    let argument = |text: &str| text.trim().rsplit([' ', '*']).next().unwrap_or_default().to_owned();
    split.map(|(name, arguments)| (name.to_owned(), arguments.split(',').map(argument).collect())).collect()
}

/// Number of results of a function; `None` for updates.
fn written(name: &str, lengths: &Lengths, header: &str) -> Option<usize> {
    match name {
        "prepare" => None,
        "residual" => Some(lengths.y),
        "jacobian" => Some(lengths.nonzeros),
        "rates" => Some(defined(header, "STATES")),
        "parameters" | "initial_states" | "initial_discretes" | "disturb" | "start" | "end" => None,
        _ if name.starts_with("event_") => None,
        _ => Some(defined(header, &name.to_uppercase())),
    }
}

/// The program: without input it prints tables; else it reads t, cj, y, yp, u, p, c for each point and writes what each function gives.
fn driver(functions: &[(String, Vec<String>)], lengths: &Lengths, header: &str) -> String {
    let Lengths { y, u, p, c, .. } = *lengths;
    let largest = functions.iter().filter_map(|(name, _)| written(name, lengths, header)).max().unwrap_or(1).max(1);
    let mut text = String::from("#include \"exported.h\"\n#include <stdio.h>\n#include <string.h>\n");
    let total = 2 + 2 * y + u + p + c;
    let _ =
        writeln!(text, "static double in[{total}], work[{}], out[{largest}], y2[{}], p2[{}];", defined(header, "WORK") + 1, y + 1, p + 1);
    text += "int main(void)\n{\n    if (fread(in, sizeof(double), 1, stdin) != 1) {\n";
    for (table, n) in [("parameters", p), ("context", c)] {
        let letter = &table[..1];
        let _ = writeln!(
            text,
            "        for (int i = 0; i < {n}; ++i) printf(\"{letter} %.17g %s\\n\", exported_{table}_table[i].nominal, exported_{table}_table[i].name);"
        );
    }
    text += "        return 0;\n    }\n    do {\n";
    let _ = writeln!(text, "        if (fread(in + 1, sizeof(double), {}, stdin) != {}) return 1;", total - 1, total - 1);
    let _ = writeln!(
        text,
        "        const double t = in[0], cj = in[1], *y = in + 2, *yp = y + {y}, *u = yp + {y}, *p = u + {u}, *c = p + {p}, *w = work;\n        (void)c; (void)cj;"
    );
    text += "        exported_prepare(u, p, work);\n";
    for (name, arguments) in functions.iter().filter(|(name, _)| name != "prepare") {
        match written(name, lengths, header) {
            Some(n) => {
                let _ =
                    writeln!(text, "        exported_{name}({});\n        fwrite(out, sizeof(double), {n}, stdout);", arguments.join(", "));
            }
            None => {
                let changed = arguments.iter().map(|a| if a == "y" || a == "p" { format!("{a}2") } else { a.clone() });
                let _ = writeln!(text, "        memcpy(y2, y, {y} * sizeof(double));\n        memcpy(p2, p, {p} * sizeof(double));");
                let _ = writeln!(text, "        exported_{name}({});", changed.collect::<Vec<_>>().join(", "));
                let _ =
                    writeln!(text, "        fwrite(y2, sizeof(double), {y}, stdout);\n        fwrite(p2, sizeof(double), {p}, stdout);");
            }
        }
    }
    text + "    } while (fread(in, sizeof(double), 1, stdin) == 1);\n    return 0;\n}\n"
}

/// Place of an element of `p` or `c`.
fn place(name: &str, model: &CompiledModel, k: &Catalogue) -> (Region, usize) {
    const BUILTINS: [(&str, Builtin); 6] = [
        ("steps", Builtin::Steps),
        ("clock", Builtin::Clock),
        ("step_length", Builtin::StepLength),
        ("last_step", Builtin::LastStep),
        ("failed", Builtin::Failed),
        ("action_excess", Builtin::ActionExcess),
    ];
    for (family, region) in [(&k.parameters, Region::Param), (&k.discretes, Region::Discrete), (&k.disturbances, Region::Disturbance)] {
        if let Some(element) = family.find(name) {
            return (region, element.at);
        }
    }
    if let Some((_, builtin)) = BUILTINS.iter().find(|(known, _)| *known == name) {
        return (Region::Builtin, *builtin as usize);
    }
    let (variable, element) = match name.strip_suffix(']').and_then(|n| n.rsplit_once('[')) {
        Some((variable, element)) => (variable, element.parse::<usize>().map_or(0, |n| n - 1)),
        None => (name, 0),
    };
    for (role, region) in [(Role::Param, Region::Param), (Role::Discrete, Region::Discrete), (Role::Disturbance, Region::Disturbance)] {
        if let Some((var, _)) = model.model().vars.iter().find(|(_, v)| v.name == variable && v.role == role) {
            return (region, model.offset(var).expect("a place") + element);
        }
    }
    let (kind, inside) = name.strip_suffix(')').and_then(|n| n.split_once('(')).unwrap_or_else(|| panic!("no place for {name}"));
    let last = || inside.rsplit(',').next().and_then(|n| n.parse::<usize>().ok()).expect("a number") - 1;
    let frame: fn(FramePart) -> Region = match kind {
        "draw" => return (Region::Draw, last()),
        "integral" => return (Region::Quadrature, last()),
        "given" => return (Region::ParamGiven, k.parameters.find(inside).expect("a parameter").at),
        "initial" => Region::Initial,
        "previous" => Region::Previous,
        "steady" => Region::Steady,
        _ => panic!("no place for {name}"),
    };
    for (family, part) in [
        (&k.states, FramePart::Y),
        (&k.solved, FramePart::Y),
        (&k.actions, FramePart::Action),
        (&k.discretes, FramePart::Discrete),
        (&k.disturbances, FramePart::Disturbance),
    ] {
        if let Some(element) = family.find(inside) {
            return (frame(part), element.at);
        }
    }
    panic!("no place for {name}")
}

/// Numbers that look random, the same in every run.
struct Random(u64);

impl Random {
    /// In 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Near a number; of the order of one if it is not finite, or zero.
    fn near(&mut self, x: f64) -> f64 {
        if x.is_finite() && x.abs() > 1e-12 { x * (0.9 + 0.2 * self.next()) } else { 0.5 + self.next() }
    }

    /// A value for a place of the workspace.
    fn value(&mut self, region: Region, at: usize, nominal: f64) -> f64 {
        match region {
            Region::Builtin if at == Builtin::Steps as usize => (self.next() * 20.0).floor(),
            Region::Builtin if at >= Builtin::LastStep as usize && at <= Builtin::Failed as usize => self.next().round(),
            Region::ParamGiven => self.next().round(),
            Region::Draw => 0.05 + 0.9 * self.next(),
            _ => self.near(nominal),
        }
    }
}

struct Point {
    t: f64,
    cj: f64,
    y: Vec<f64>,
    yp: Vec<f64>,
    memory: Memory,
    input: Vec<f64>,
}

/// A point, with the vectors of the exported functions.
fn point(model: &CompiledModel, k: &Catalogue, tables: &[Vec<(String, f64)>; 2], random: &mut Random) -> Point {
    let mut memory = model.memory();
    let (mut y, mut yp) = (vec![0.0; model.unknowns()], vec![0.0; model.unknowns()]);
    let (t, cj) = (random.near(1.0), random.near(3.0));
    let mut input = vec![t, cj];
    let unknowns = || k.states.elements().iter().chain(k.solved.elements());
    for element in unknowns() {
        y[element.at] = random.near(element.default).clamp(element.low.max(-1e300), element.high.min(1e300));
        yp[element.at] = random.next() - 0.5;
    }
    input.extend(unknowns().map(|e| y[e.at]));
    input.extend(unknowns().map(|e| yp[e.at]));
    for element in k.actions.elements() {
        let value = random.near(element.default);
        memory.region_mut(Region::Action)[element.at] = value;
        input.push(value);
    }
    for (name, nominal) in tables.iter().flatten() {
        let (region, at) = place(name, model, k);
        let structural = k.parameters.find(name).is_some_and(|e| e.structural);
        let value = if structural { *nominal } else { random.value(region, at, *nominal) };
        memory.region_mut(region)[at] = value;
        input.push(value);
    }
    model.prepare_parameters(&mut memory);
    model.prepare_step(&mut memory);
    Point { t, cj, y, yp, memory, input }
}

/// Results of the machine code for a function, in the order of the export.
fn expected(name: &str, model: &CompiledModel, k: &Catalogue, tables: &[Vec<(String, f64)>; 2], point: &Point) -> Vec<f64> {
    let Point { t, cj, y, yp, memory, .. } = point;
    let (mut m, mut y2) = (memory.clone(), y.clone());
    let interface = model.interface();
    let order: Vec<usize> = k.states.elements().iter().chain(k.solved.elements()).map(|e| e.at).collect();
    let mut out = vec![0.0; model.unknowns()];
    let mut finish = vec![0.0; model.finish_len()];
    let f = &interface.finish;
    let ends: Vec<usize> = [2 * f.failures.len(), f.successes.len(), f.constraints.len(), f.rewards.len(), f.observations.len()]
        .iter()
        .scan(0, |sum, n| {
            *sum += *n;
            Some(*sum)
        })
        .collect();
    match name {
        "residual" => model.residual(&mut m, *t, y, yp, &mut out),
        "rates" | "algebraic" => model.residual(&mut m, *t, y, &vec![0.0; y.len()], &mut out),
        "jacobian" => {
            let mut values = vec![0.0; model.pattern().nonzeros()];
            model.jacobian(&mut m, *t, y, yp, *cj, &mut values);
            return entries(model, &order).into_iter().map(|(_, slot)| values[slot]).collect();
        }
        "outputs" | "events" | "integrals" | "invariants" | "boxes" => {
            let n = match name {
                "outputs" => k.algebraics.len(),
                "events" => model.watched().len(),
                "integrals" => model.quadratures(),
                "invariants" => 2 * interface.invariants.len(),
                _ => interface.finish.failures.iter().map(|f| f.items.len()).sum(),
            };
            let mut out = vec![0.0; n];
            match name {
                "outputs" => model.outputs(&mut m, *t, y, yp, &mut out),
                "events" => model.roots(&mut m, *t, y, yp, &mut out),
                "integrals" => model.quadrature_rates(&mut m, *t, y, yp, &mut out),
                "invariants" => model.invariants(&mut m, *t, y, yp, &mut out),
                _ => model.boxes(&mut m, *t, y, yp, &mut out),
            }
            if name == "events" {
                // Switches of the equations are the integrator's.
                out.truncate(model.roots_info().len());
            }
            return out;
        }
        "failures" | "successes" | "constraints" | "rewards" | "observations" => {
            model.finish(&mut m, *t, y, yp, &mut finish);
            let part = ["failures", "successes", "constraints", "rewards", "observations"].iter().position(|n| *n == name).unwrap();
            return finish[part.checked_sub(1).map_or(0, |before| ends[before])..ends[part]].to_vec();
        }
        "parameters" => model.parameters(&mut m),
        "initial_states" => model.initial_states(&mut m, &mut y2),
        "initial_discretes" => model.initial_discretes(&mut m, &mut y2),
        "disturb" => model.disturb(&mut m, *t),
        "start" => model.start(&mut m, *t, &mut y2),
        "end" => model.end(&mut m, *t, &mut y2),
        _ => {
            if let Some(policy) = name.strip_prefix("policy_") {
                let index = model.model().programs.policies.iter().position(|(known, _)| known == policy).expect("a policy");
                let mut out = vec![0.0; k.actions.len()];
                model.policy(index, &mut m, *t, y, &mut out);
                return out;
            }
            let index = name.strip_prefix("event_").and_then(|n| n.parse().ok()).unwrap_or_else(|| panic!("unknown function {name}"));
            model.event(index, &mut m, *t, &mut y2);
        }
    }
    if name == "residual" || name == "rates" || name == "algebraic" {
        let all: Vec<f64> = order.iter().map(|&at| out[at]).collect();
        let (states, solved) = all.split_at(k.states.len());
        return match name {
            "residual" => all,
            "rates" => states.to_vec(),
            _ => solved.to_vec(),
        };
    }
    let p = tables[0].iter().map(|(name, _)| {
        let (region, at) = place(name, model, k);
        m.region(region)[at]
    });
    order.iter().map(|&at| y2[at]).chain(p).collect()
}

/// Compares every function at so many points, relative to the largest value that a row takes.
fn compare(path: &Path, options: &LoadOptions, count: usize, effort: &str) {
    let loaded = load(path, options).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let program = Program::new(&loaded, effort);
    let (model, k) = (&*loaded.model, Catalogue::new(&loaded.model));
    let tables = program.tables();
    assert_eq!((tables[0].len(), tables[1].len()), (program.lengths.p, program.lengths.c));
    let mut random = Random(1);
    let points: Vec<Point> = (0..count).map(|_| point(model, &k, &tables, &mut random)).collect();
    assert!(points.iter().all(|p| p.input.len() == 2 + 2 * program.lengths.y + program.lengths.u + program.lengths.p + program.lengths.c));
    let bytes = program.run(&points.iter().flat_map(|p| p.input.iter().copied()).collect::<Vec<_>>());
    let mut found = bytes.chunks_exact(8).map(|b| f64::from_ne_bytes(b.try_into().expect("eight bytes")));
    let names: Vec<&String> = program.functions.iter().map(|(name, _)| name).filter(|n| *n != "prepare").collect();
    let mut pairs: Vec<Vec<Vec<(f64, f64)>>> = vec![vec![]; names.len()];
    for point in &points {
        for (name, rows) in names.iter().zip(&mut pairs) {
            let values = expected(name, model, &k, &tables, point);
            rows.resize(values.len(), vec![]);
            values.iter().zip(rows).for_each(|(value, row)| row.push((found.next().expect("a number"), *value)));
        }
    }
    assert_eq!(found.next(), None);
    for (name, rows) in names.iter().zip(&pairs) {
        let finite = rows.iter().flatten().filter(|(_, e)| e.is_finite()).count();
        assert!(2 * finite >= rows.len() * count, "{name} of {}: only {finite} numbers", path.display());
        // A derivative may be a small difference of large ones: rounding follows the largest of its row.
        let rest = if *name == "jacobian" { rounding_of_rows(model, &k, rows) } else { vec![0.0; rows.len()] };
        for (number, row) in rows.iter().enumerate() {
            let largest = row.iter().map(|(_, e)| e.abs()).filter(|e| e.is_finite()).fold(0.0, f64::max);
            for &(found, expected) in row {
                let same = found == expected
                    || found.is_nan() && expected.is_nan()
                    || (found - expected).abs() <= TOLERANCE * largest + rest[number];
                assert!(same, "{name}[{number}] of {}: {found:e}, expected {expected:e}", path.display());
            }
        }
    }
}

/// Row of each entry of the Jacobian in public order, and its place in the compiled one.
fn entries(model: &CompiledModel, order: &[usize]) -> Vec<(usize, usize)> {
    let pattern = model.pattern();
    let mut outside = vec![0; order.len()];
    order.iter().enumerate().for_each(|(i, &at)| outside[at] = i);
    let column = |&at: &usize| {
        let slots = pattern.column_pointers[at]..pattern.column_pointers[at + 1];
        let mut entries: Vec<(usize, usize)> = slots.map(|slot| (outside[pattern.row_indices[slot]], slot)).collect();
        entries.sort_unstable();
        entries
    };
    order.iter().flat_map(column).collect()
}

/// Effect of rounding on each entry of the Jacobian: a few units in the last place of the largest entry of its row.
fn rounding_of_rows(model: &CompiledModel, k: &Catalogue, entries: &[Vec<(f64, f64)>]) -> Vec<f64> {
    let order: Vec<usize> = k.states.elements().iter().chain(k.solved.elements()).map(|e| e.at).collect();
    let rows: Vec<usize> = self::entries(model, &order).into_iter().map(|(row, _)| row).collect();
    let mut largest = vec![0.0_f64; order.len()];
    for (&row, values) in rows.iter().zip(entries) {
        let own = values.iter().map(|(_, e)| e.abs()).filter(|e| e.is_finite()).fold(0.0, f64::max);
        largest[row] = largest[row].max(own);
    }
    rows.iter().map(|&row| 1e-14 * largest[row]).collect()
}

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn scenario(name: Option<&str>) -> LoadOptions {
    LoadOptions { scenario: name.map(str::to_owned), ..LoadOptions::default() }
}

/// A model with its scenarios, then each variant alone.
fn all_of(name: &str, scenarios: &[&str], count: usize) {
    let path = models().join(name).with_extension("eq");
    compare(&path, &scenario(None), count, "-O2");
    for name in scenarios {
        compare(&path, &scenario(Some(name)), count, "-O0");
    }
    let loaded = load(&path, &scenario(None)).expect("a model");
    let interface = loaded.model.interface();
    let switches = interface.alternatives.variants.iter().map(|variant| variant.name.clone());
    let options = interface.alternatives.choices.iter().flat_map(|choice| {
        let others = choice.options.iter().filter(|option| choice.chosen() != Some(option));
        others.map(|option| format!("{}={option}", choice.name))
    });
    for variant in switches.chain(options) {
        let options = LoadOptions { variants: vec![Variant::parse(&variant)], ..LoadOptions::default() };
        // Some variants require others.
        if load(&path, &options).is_ok() {
            compare(&path, &options, count.min(20), "-O0");
        }
    }
}

#[test]
fn the_reactor_in_c_computes_what_the_machine_code_does() {
    all_of("reactor", &["legacy"], 1000);
}

#[test]
fn the_beer_in_c_computes_what_the_machine_code_does() {
    all_of("beer", &["legacy"], 1000);
}

#[test]
fn pensim_in_c_computes_what_the_machine_code_does() {
    all_of("pensim", &["legacy"], 1000);
}

#[test]
fn atropine_in_c_computes_what_the_machine_code_does() {
    all_of("atropine", &["legacy", "coupled39"], 100);
}

#[test]
fn the_capture_column_in_c_computes_what_the_machine_code_does() {
    all_of("mab", &["legacy"], 100);
}

#[test]
fn the_antibody_plant_in_c_computes_what_the_machine_code_does() {
    all_of("mab_plant", &["chain_legacy"], 100);
}

#[test]
fn every_test_problem_in_c_computes_what_the_machine_code_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/problems");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).expect("problems").map(|entry| entry.expect("a file").path()).collect();
    paths.sort();
    for path in paths.iter().filter(|path| path.extension().is_some_and(|e| e == "eq")) {
        compare(path, &LoadOptions::default(), 200, "-O0");
    }
}

/// Quantities that only functions of a whole step need have the units of the text.
#[test]
fn context_has_its_units() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("units.eq");
    let text = "model Units
        time t : min
        action u : L/min = 1 in 0..2
        state x : L = 1 in 0..3
        state T : degC = 20 in 0..30
        eq d/dt x = u - x / 2 [min]
        eq d/dt T = 1 [K/min]
        observe x
        reward r default = integral(x) / 1 [L min] + integral(value(u)) / 1 [min] + integral(T - 20 [degC]) / 1 [K min]
          + (T - previous(T)) / 1 [K] + (u - previous(u)) / 1 [L/min] + (x - initial(x)) / 1 [L] + clock / 1 [min] + n
        episode { step = 1 [min], max_steps = 3, error_reward = -1 }";
    std::fs::write(&path, text).expect("written");
    let loaded = load(&path, &LoadOptions::default()).expect("a model");
    let module = export(&loaded, Target::Casadi, None, None).expect("an export").remove(0).text;
    let table = module.split("CONTEXT = [").nth(1).and_then(|rest| rest.split("\n]").next()).expect("a table");
    let units: Vec<(&str, &str)> = table
        .lines()
        .filter_map(|line| {
            let mut quoted = line.split('"').skip(1).step_by(2);
            Some((quoted.next()?, quoted.next()?))
        })
        .collect();
    for wanted in [
        ("steps", "1"),
        ("clock", "min"),
        ("integral(1)", "L min"),
        ("integral(2)", "min"),
        ("integral(3)", "K min"),
        ("previous(T)", "degC"),
        ("previous(u)", "L/min"),
        ("initial(x)", "L"),
    ] {
        assert!(units.contains(&wanted), "{wanted:?} is not among {units:?}");
    }
}

#[test]
fn the_same_model_gives_the_same_text() {
    let loaded = load(&models().join("pensim.eq"), &LoadOptions::default()).expect("a model");
    // An FMU is not a text: fmus.rs tests it.
    for (_, target) in Target::ALL.iter().copied().filter(|(_, target)| *target != Target::Fmu) {
        let texts = || export(&loaded, target, None, None).expect("an export").into_iter().map(|file| file.text).collect::<Vec<_>>();
        assert_eq!(texts(), texts(), "{}", target.name());
    }
}
