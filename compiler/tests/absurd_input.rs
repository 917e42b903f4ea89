//! Absurd models: every one ends in a model or in faults, without a panic, soon, and within a small stack.

use std::time::{Duration, Instant};

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::{Diagnostic, SHOWN, SourceMap};

/// Soon: no slow or busy machine takes that long, and what grows exponentially takes longer.
const SOON: Duration = Duration::from_secs(60);

/// Flattens on a stack too small for anything: the compiler brings its own.
fn faults(source: &str) -> Vec<Diagnostic> {
    let source = source.to_owned();
    let work = move || {
        let mut sources = SourceMap::new();
        let main = sources.add("model.eq", source);
        flatten(&mut sources, main, &mut |_| None, &Options::default()).err().unwrap_or_default()
    };
    let start = Instant::now();
    let found = std::thread::Builder::new().stack_size(128 << 10).spawn(work).expect("a thread").join().expect("no panic");
    assert!(start.elapsed() < SOON, "{:?}", start.elapsed());
    found
}

fn chain(n: usize, link: impl Fn(usize) -> String) -> String {
    let links: String = (1..=n).map(|i| link(i) + "\n").collect();
    format!("{links}state x = 1\neq d/dt x = -a{n} * x / 1 [s]\n")
}

fn refused(source: &str, code: &str) {
    let found = faults(source);
    assert!(
        found.iter().any(|d| d.code.id().starts_with(code)),
        "{:?}\n{}",
        found.iter().map(|d| &d.message).collect::<Vec<_>>(),
        &source[..source.len().min(400)]
    );
}

#[test]
fn long_chains_of_definitions() {
    let let_chain = |n| chain(n, |i| if i == 1 { "let a1 = 1".into() } else { format!("let a{i} = a{} + 1", i - 1) });
    assert!(faults(&let_chain(200)).is_empty());
    refused(&let_chain(20_000), "E0105");
    let parameters = |n| chain(n, |i| if i == 1 { "param a1 = 1".into() } else { format!("param a{i} = a{} + 1", i - 1) });
    assert!(faults(&parameters(20_000)).is_empty());
    let variables =
        chain(5_000, |i| if i == 1 { "var a1 = 1\neq a1 = x".into() } else { format!("var a{i} = 1\neq a{i} = a{} + 1", i - 1) });
    assert!(faults(&variables).is_empty());
    let functions = chain(2_000, |i| if i == 1 { "def a1(q) = q".into() } else { format!("def a{i}(q) = a{}(q) + 1", i - 1) });
    refused(&functions.replace("-a2000 *", "-a2000(x) *"), "E0105");
}

#[test]
fn definitions_that_double_at_each_level() {
    let lets = chain(60, |i| if i == 1 { "let a1 = x".into() } else { format!("let a{i} = a{0} * a{0} + a{0}", i - 1) });
    assert!(faults(&lets).is_empty());
    let variables =
        chain(60, |i| if i == 1 { "var a1 = 1\neq a1 = x".into() } else { format!("var a{i} = 1\neq a{i} = a{0} * a{0} + a{0}", i - 1) });
    assert!(faults(&variables).is_empty());
    let functions = chain(60, |i| if i == 1 { "def a1(q) = q".into() } else { format!("def a{i}(q) = a{0}(q) + a{0}(q + 1)", i - 1) });
    refused(&functions.replace("-a60 *", "-a60(x) *"), "E0105");
}

/// Found by fuzzing: the words of a line were looked up once for each of its faults.
#[test]
fn thousands_of_faults_on_one_line() {
    assert!(!faults(&format!("state x = 1\nlet a = {}\n", "b) ".repeat(30_000))).is_empty());
}

#[test]
fn sizes_beyond_reason() {
    let rest = "state x = 1\neq d/dt x = -x / 1 [s]\n";
    for head in [
        "set s = 1..1e18",
        "set s = 1..-1e14",
        "set s = -1e14..1e14",
        "domain z in 0..1 cells 1e300",
        "domain z in 0..1 cells -3",
        "domain z in 0..1 cells 0/0",
        "set s = 1..1000\nstate c[s, i in s, j in s] = 0",
        "let b = sum(i for i in 1..1e9)",
        "let b = sum(i*j*k for i in 1..5000, j in 1..5000, k in 1..5000)",
        "set s = 1..10000\nlet b = sum(i*j for i in s, j in s)",
        "set s = 1..90000\nstate c[s] = 0\neq d/dt c[i] = -sum(c[j] for j in s) / 1 [s] for i in s",
        "set s = 1..90000\nstate c[s] = 0\neq d/dt c[i] = -sum(c[j] for j in unknown) / 1 [s] for i in s",
    ] {
        assert!(!faults(&format!("{head}\n{rest}")).is_empty(), "{head}");
    }
    assert!(faults(&format!("domain z in 0..1 cells 50000000\nstate c[z] = 0\neq d/dt c[z] = -c[z]/1 [s] for z\n{rest}")).len() <= 1);
}

/// Each is refused at a place in the text, before the instances are made.
#[test]
fn components_that_multiply() {
    let atom = "component A0 { state x = 1 ; eq d/dt x = -x / 1 [s] }\n";
    let levels: String = (1..=40).map(|i| format!("component A{i} {{ use A{0} as i ; use A{0} as j }}\n", i - 1)).collect();
    let arrays = "component B { use A0 as a[i in 1..1000] }\ncomponent C { use B as b[i in 1..1000] }\nuse C as c[i in 1..1000]\n";
    for (source, code) in [
        ("component A { state x = 1 ; use A as i ; use A as j }\nuse A as a\n".to_owned(), "E0205"),
        ("component A { use B as i ; use B as j }\ncomponent B { use A as i ; use A as j }\nuse A as a\n".to_owned(), "E0205"),
        ("component A { use A as a[i in 1..1000] }\nuse A as c[i in 1..1000]\n".to_owned(), "E0205"),
        (format!("{atom}{levels}use A40 as a\n"), "E0105"),
        (format!("{atom}{levels}use A25 as a\n"), "E0105"),
        (format!("{atom}{arrays}"), "E0105"),
    ] {
        refused(&source, code);
        assert!(faults(&source).iter().all(|d| d.primary.span.end > 0), "{source}");
    }
    assert!(faults(&format!("{atom}{levels}use A6 as a\n")).is_empty());
}

/// All are counted and the first ones shown.
#[test]
fn a_hundred_thousand_faults() {
    const N: usize = 100_000;
    let lines = |line: &dyn Fn(usize) -> String| (0..N).map(|i| line(i) + "\n").collect::<String>();
    for (text, count) in [
        (lines(&|i| format!("let a{i} = nope{i}")), N),
        (lines(&|_| "let a = 1".to_owned()), N - 1),
        (lines(&|_| "eq d/dt x = -x / 1 [s]".to_owned()), N),
        (lines(&|i| format!("var a{i} = 1")), N),
        (lines(&|i| format!("let a{i} : kq = 1")), N),
        (lines(&|_| "let = 3".to_owned()), N),
        (lines(&|i| format!("def f{i}(q) = y\nlet a{i} = f{i}(1)")), N),
    ] {
        let found = faults(&format!("state x = 1\neq d/dt x = -x / 1 [s]\n{text}"));
        let head = &text[..text.find('\n').unwrap_or(0)];
        assert_eq!(found.len(), SHOWN + 1, "{head}");
        assert_eq!(found[SHOWN].message, format!("{} more faults are not shown", count - SHOWN), "{head}");
    }
    let chain = |n: usize| (0..n).rev().map(|i| format!("let a{} = a{i} + 1\n", i + 1)).collect::<String>();
    refused(&format!("{}let a0 = 1\nstate x = 1\neq d/dt x = -a{N} * x / 1 [s]\n", chain(N)), "E0105");
    let rows: String = (0..N).map(|i| format!("{i}: {}\n", i % 7)).collect();
    assert!(faults(&format!("set s = 0..{}\ntable f[s] = {{\n{rows}}}\nstate x = 1\neq d/dt x = -x * f[9] / 1 [s]\n", N - 1)).is_empty());
}

/// A thread of a mebibyte, as Python gives them, overflowed.
#[test]
fn a_thousand_lets_in_a_circle() {
    let circle: String = (0..1000).map(|i| format!("let a{i} = a{}\n", (i + 1) % 1000)).collect();
    assert!(!faults(&format!("{circle}state x = 1\neq d/dt x = -a0 * x / 1 [s]\n")).is_empty());
}

#[test]
fn loops_in_loops_in_loops() {
    let six = |over: &str| (0..6).map(|i| format!("i{i} in {over}")).collect::<Vec<_>>().join(", ");
    let product = |of: &dyn Fn(usize) -> String| (0..6).map(of).collect::<Vec<_>>().join(" * ");
    let numbers = product(&|i| format!("i{i}"));
    let elements = product(&|i| format!("c[i{i}]"));
    let nested = (0..6).fold("1".to_owned(), |inner, i| format!("sum({inner} * c[i{i}] for i{i} in s)"));
    let pairs = |body: &str| (0..130).fold(body.to_owned(), |inner, i| format!("sum({inner} for i{i} in 1..2)"));
    let set = "set s = 1..1000\nstate c[s] = 1\neq d/dt c[i] = 0 for i in s\nstate x = 1\n";
    for text in [
        format!("state x = 1\neq d/dt x = sum({numbers} for {})", six("1..1000")),
        format!("{set}eq d/dt x = sum({elements} for {})", six("s")),
        format!("{set}eq d/dt x = {nested}"),
        format!("set s = 1..1000\nstate c[s] = 1\nstate x = 1\neq d/dt x = 0\neq d/dt c[i0] = {elements} for {}", six("s")),
        format!(
            "domain z in 0..1 cells 1000\nstate c[z] = 1\neq d/dt c[z] = 0 for z\nstate x = 1\neq d/dt x = sum({elements} for {})",
            six("z")
        ),
        format!("state x = 1\neq d/dt x = {}", pairs("x")),
        format!("state x = 1\neq d/dt x = {}", pairs("y")),
    ] {
        refused(&text, "E0105");
    }
}

#[test]
fn numbers_at_the_edge() {
    for number in
        ["1e308 * 10", "0/0", "1/0", "-1/0", "(-1)^0.5", "0^0", "0^-1", "inf", "-inf", "inf - inf", "ln(0)", "ln(-1)", "1e-320", "10^400"]
    {
        for place in [
            "param p = #",
            "state p = #\neq d/dt p = 0",
            "action p = # in 0..1",
            "action p = 0.5 in #..1",
            "let p : 1 = #",
            "discrete p = #",
            "state p = 1 in 0..# scale #\neq d/dt p = 0",
            "table p[s] = { a: # }",
            "table p over time : s linear { 0: 1, #: 2 }",
            "domain p in 0..# cells 4\nstate c[p] = 0\nflux J[p] = c[p] * 1 [1/s]\neq d/dt c[p] = -div(J[p]) for p",
            "domain p in 0..1 cells 4 stretch #\nstate c[p] = 0\nflux J[p] = c[p] * 1 [1/s]\neq d/dt c[p] = -div(J[p]) for p",
            "episode { step = # }",
            "episode { max_steps = # }",
            "solver { rtol = # }",
            "reward p default = #",
            "fail p when x < #",
            "observe x in 0..# every #",
        ] {
            faults(&format!("set s = {{ a }}\n{}\nstate x = 1\neq d/dt x = -x / 1 [s]\n", place.replace('#', number)));
        }
    }
}

#[test]
fn things_that_need_themselves() {
    for source in [
        "param a = a",
        "param a = b\nparam b = a",
        "let a = a",
        "def f(x) = f(x)\nlet a = f(1)",
        "def f(x) = g(x)\ndef g(x) = f(x)\nlet a = f(1)",
        "component A { use A as a }\nuse A as b",
        "component A { use B as a }\ncomponent B { use A as a }\nuse A as b",
        "domain z in 0..1 cells z.cells\nstate c[z] = 0\neq d/dt c[z] = 0 for z",
        "domain z in 0..z.last cells 3\nstate c[z] = 0\nflux J[z] = c[z] / 1 [s]\neq d/dt c[z] = -div(J[z]) for z",
        "set s = 1..s",
        "flux J[z] = J[z]\ndomain z in 0..1 cells 3\nstate c[z] = 0\neq d/dt c[z] = -div(J[z]) / 1 [s] for z",
        "flux J[z] = div(J[z]), low = J[z.low]\ndomain z in 0..1 cells 3\nstate c[z] = 0\neq d/dt c[z] = -div(J[z]) / 1 [s] for z",
        "state y = y\neq d/dt y = 0",
        "state y = z\nstate z = y\neq d/dt y = 0\neq d/dt z = 0",
        "state y = 1\neq d/dt y = der(y)",
        "state y = 1 in low(y)..high(y)\neq d/dt y = 0",
        "state y = 1 scale scale(y)\neq d/dt y = 0",
        "param p = low(p)",
        "table f over time : s until { f(1): 2 }",
        "table k[s] = { a: k[a] }\nset s = { a }",
        "param p : [unit(p)] = 1",
        "param p = 1 [unit(p)]",
        "state q = 1\neq d/dt q = steady(steady(q)) / 1 [s]",
        "state q = initial(q)\neq d/dt q = 0",
    ] {
        faults(&format!("{source}\nstate x = 1\neq d/dt x = -x / 1 [s]\n"));
    }
}

#[test]
fn kinds_where_others_belong() {
    let names = [
        "a_set",
        "z",
        "flow",
        "comp",
        "comp.x",
        "f",
        "tab",
        "timetab",
        "ch",
        "x",
        "t",
        "act",
        "r",
        "low",
        "end_is_success",
        "phase",
        "T[1]",
        "T",
        "x.y.z",
        "z.last",
    ];
    let places = [
        "eq d/dt x = # / 1 [s]",
        "let q = #[1]",
        "let q = #(x)",
        "let q = #.x",
        "let q = x[#]",
        "let q = sum(i for i in #)",
        "let q = sum(# for # in a_set)",
        "state w[#] = 1",
        "eq # = 1",
        "connect # -> #",
        "use # as new",
        "port # : #",
        "initial # = 1",
        "steady { # = 1 }",
        "policy p { # = 1 }",
        "at start { next # = 1 ; reset # = 1 }",
        "at # { reset x = 1 }",
        "observe #",
        "observe new = # in 0..1 every # delay # noise #",
        "fail new when #",
        "fail new when outside bounds(#)",
        "event new when # > #",
        "reward new = #",
        "let q = div(#)",
        "let q = div(#[z])",
        "let q = grad(#)",
        "let q = initial(#) + previous(#) + steady(#)",
        "let q = der(#)",
        "let q = low(#) + high(#) + scale(#) + nominal(#)",
        "let q = value(#, #)",
        "let q = kelvin(#)",
        "let q = width(#) + volume(#)",
        "param new = # ~ #",
        "param new : # = 1",
        "discrete new = #",
        "disturbance new = # ~ #",
        "domain new in #..# cells #",
        "flux new[#] = #",
        "flux new[z] = #, low = #, high = #\neq der(c[z]) = -div(new[z]) for z",
        "phase new until # then #",
        "when # = # { param k = 1 }",
        "invariant new = # rate #",
        "set new = #..#",
        "table new[#] = { a: # }",
        "table over # { columns: u, v\n a: 1, 2 }",
        "eq d/dt x = 1 for # in #",
        "let q = if # then # else #",
        "let q = # and not #",
        "let q = integral(#)",
        "let q = integral(# for z)",
        "let q = upwind(#, #)",
    ];
    for name in names {
        for place in places {
            faults(&format!(
                "set a_set = {{ a, b }}\ndomain z in 0..1 cells 3\nflux flow[z] = c[z]\nstate c[z] = 0\ncomponent comp_kind {{ state x = 1 ; eq d/dt x = 0 }}
                 use comp_kind as comp\nuse comp_kind as T[k in 1..2]\ndef f(q) = q\ntable tab[a_set] = {{ a: 1, b: 2 }}\ntable timetab over time : s until {{ 1: 2 }}
                 choice ch = p | q\naction act = 0 in 0..1\nrandom r ~ normal(0, 1)\nstate x = 1\n{}\n",
                place.replace('#', name)
            ));
        }
    }
}
