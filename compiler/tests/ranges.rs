//! Ranges of numbers stay loops, with the numbers that the same equations give when they are worked out one by one.

mod running;

use running::{Running, assert_close, flat};

/// Rates of `x` and `w` by a function of all of both and of the index, from 0.
fn check(n: usize, source: &str, rate: impl Fn(&[f64], usize) -> f64) {
    let mut r = Running::new(source);
    assert_eq!(r.model.unknowns(), n, "only the states are unknown:\n{source}");
    let x: Vec<f64> = (0..n).map(|i| 0.3 + (i as f64).sin() * 0.2).collect();
    for (i, x) in x.iter().enumerate() {
        r.set(&format!("x[{}]", i + 1), *x);
    }
    let rates = r.rates();
    for (i, found) in rates.iter().enumerate() {
        assert_close(*found, rate(&x, i));
    }
}

/// A model with a state `x` over `1..n` and some more lines.
fn model(n: usize, lines: &str) -> String {
    format!("set s = 1..{n}\nparam M[i in s] = 1 + 0.1*i\nstate x[i in s] = 0.5\naction u = 1 in 0..2\n{lines}")
}

/// Numbers of `1..n` for which loops are kept, and for which they are not.
const LENGTHS: [usize; 3] = [5, 16, 40];

#[test]
fn the_code_does_not_grow_with_the_range() {
    let tray = |n: usize| {
        model(
            n,
            &format!(
                "set parts = {{ a, b }}
                 state c[j in parts, i in s] = 0.1
                 let y[i in s] : 1 = 2*x[i] / (1 + x[i])
                 var z[i in s] : 1
                 eq z[i] = exp(-x[i]) * sum(c[j, i] for j in parts) for i in s
                 var v[j in parts, i in s] : 1
                 eq v[j, i] = c[j, i] * z[i] for j in parts, i in s
                 eq d/dt x[i] = (if i == 1 then u else x[i-1]) / 1 [s] - (y[i] + z[i]) / (M[i] * 1 [s]) for i in s
                 eq d/dt c[j, i] = (v[j, i] - v[j, i+1]) / 1 [s] for j in parts, i in 1..{n}-1
                 eq d/dt c[j, {n}] = -v[j, {n}] / 1 [s] for j in parts"
            ),
        )
    };
    let (small, large) = (flat(&tray(20)), flat(&tray(2000)));
    assert_eq!(small.rows.len(), large.rows.len());
    let (small, large) = (Running::of(small), Running::of(large));
    assert_eq!(large.model.unknowns(), 6000);
    let ratio = large.model.code_len() as f64 / small.model.code_len() as f64;
    assert!(ratio < 1.1, "{} and {} bytes", small.model.code_len(), large.model.code_len());
}

#[test]
fn neighbours_and_numbers_of_a_range() {
    for n in LENGTHS {
        let source =
            model(n, "eq d/dt x[i] = ((if i < 3 then u else x[i-2]) - i*x[i] + (if i >= 4 then x[3] else 0)) / (M[i] * 1 [s]) for i in s");
        check(n, &source, |x, i| {
            let feed = if i < 2 { 1.0 } else { x[i - 2] };
            let third = if i >= 3 { x[2] } else { 0.0 };
            (feed - (i + 1) as f64 * x[i] + third) / (1.0 + 0.1 * (i + 1) as f64)
        });
    }
}

#[test]
fn sums_with_conditions_over_the_same_range() {
    for n in LENGTHS {
        let source = model(n, "eq d/dt x[i] = sum((x[j] - x[i]) / (i - j)^2 for j in s if j != i) / 1 [s] for i in s");
        check(n, &source, |x, i| (0..x.len()).filter(|&j| j != i).map(|j| (x[j] - x[i]) / (i as f64 - j as f64).powi(2)).sum());
        let source = model(n, "eq d/dt x[i] = sum(x[j]*x[k] for j in s, k in s if k > j and j > 2) / (i * 1 [s]) for i in s");
        check(n, &source, |x, i| {
            let pairs = (0..x.len()).flat_map(|j| (j + 1..x.len()).map(move |k| (j, k)));
            pairs.filter(|(j, _)| *j > 1).map(|(j, k)| x[j] * x[k]).sum::<f64>() / (i + 1) as f64
        });
    }
}

#[test]
fn means_and_conditions_over_a_range() {
    for n in LENGTHS {
        let source = model(
            n,
            "eq d/dt x[i] = (mean(x[j]*j for j in s) + mean(x[j] for j in s if j > 2)
               + (if any(x[j] > 0.49 for j in s if j != i) then 1 else 0) + (if all(x[j] < 0.45 for j in s) then 2 else 0)) / 1 [s] for i in s",
        );
        check(n, &source, |x, i| {
            let mean = x.iter().zip(1..).map(|(x, j)| x * f64::from(j)).sum::<f64>() / n as f64;
            let rest = x[2..].iter().sum::<f64>() / (n - 2) as f64;
            let any = x.iter().enumerate().any(|(j, x)| j != i && *x > 0.49);
            mean + rest + f64::from(u8::from(any)) + if x.iter().all(|x| *x < 0.45) { 2.0 } else { 0.0 }
        });
    }
}

#[test]
fn algebraic_variables_are_substituted_however_they_are_defined() {
    for n in LENGTHS {
        // As a whole; a sum inside, and a place inside of a sum.
        let source = model(
            n,
            "var y[i in s]\nvar z[i in s]\neq y[i] = x[i] * sum(x[j] for j in s) for i in s
             eq z[i] = y[i] + sum(y[j]*j for j in s) for i in s\neq d/dt x[i] = z[i] / 1 [s] for i in s",
        );
        check(n, &source, |x, i| {
            let total: f64 = x.iter().sum();
            x[i] * total + x.iter().enumerate().map(|(j, x)| x * total * (j + 1) as f64).sum::<f64>()
        });
        // One from the other.
        let source = model(
            n,
            "var y[i in s]\neq y[i] = (if i == 1 then u else y[i-1]) * x[i] for i in s\neq d/dt x[i] = sum(y[j] for j in s if j >= i) / 1 [s] for i in s",
        );
        check(n, &source, |x, i| (i..x.len()).map(|j| x[..=j].iter().product::<f64>()).sum());
        // In parts, and the last one by itself.
        let source = model(
            n,
            &format!(
                "var y[i in s]\neq y[i] = x[i+1] - x[i] for i in 1..{n}-1\neq y[{n}] = -x[{n}]\neq d/dt x[i] = (y[i] + y[1]) / (M[i] * 1 [s]) for i in s"
            ),
        );
        check(n, &source, |x, i| {
            let y = |i: usize| x.get(i + 1).unwrap_or(&0.0) - x[i];
            (y(i) + y(0)) / (1.0 + 0.1 * (i + 1) as f64)
        });
    }
}

#[test]
fn algebraic_variables_with_two_indices_are_substituted_by_parts() {
    for n in LENGTHS {
        for (index, order) in [("j in parts, i in s", "j, i"), ("i in s, j in parts", "i, j")] {
            let source = model(
                n,
                &format!(
                    "set parts = {{ a, b, c }}\nvar y[{index}] : 1\nvar w[{index}] : 1
                     table k[parts] = {{ a: 1, b: 2, c: 3 }}
                     eq y[{order}] = k[j]*x[i] for i in s, j in parts
                     eq w[{order}] = y[{order}] / sum(y[{}] for k in parts) + y[{}] for j in parts, i in s
                     eq d/dt x[i] = (sum(w[{order}]^2 for j in parts) + y[{}]) / 1 [s] for i in s",
                    order.replace('j', "k"),
                    order.replace('j', "a").replace("i", "1"),
                    order.replace('j', "b").replace("i", "2"),
                ),
            );
            check(n, &source, |x, _| {
                let w = |k: f64| k / 6.0 + x[0];
                [1.0, 2.0, 3.0].map(|k| w(k).powi(2)).iter().sum::<f64>() + 2.0 * x[1]
            });
            let mut r = Running::new(&source);
            let name = |order: &str| format!("y[{}]", order.replace('j', "c").replace('i', "3").replace(' ', ""));
            assert_close(r.output(&name(order)), 1.5);
        }
    }
}

#[test]
fn equations_that_a_loop_cannot_say_are_written_out() {
    let n = 20;
    // A zero is not a term: neither work nor an entry of the Jacobian.
    let rows: String = (1..=n).map(|i| format!("{i}: {}\n", i % 2)).collect();
    let table = model(n, &format!("table k[s] = {{\n{rows}}}\neq d/dt x[i] = -k[i]*(x[i] + x[{n} + 1 - i]) / 1 [s] for i in s"));
    check(n, &table, |x, i| if i % 2 == 0 { -(x[i] + x[n - 1 - i]) } else { 0.0 });
    assert_eq!(Running::new(&table).model.pattern().nonzeros(), n + n / 2, "the diagonal, and one more for each odd number");
    let power = model(n, "eq d/dt x[i] = (-x[i])^i / 1 [s] for i in s");
    check(n, &power, |x, i| (-x[i]).powi(i as i32 + 1));
    let product = model(n, "eq d/dt x[i] = product(x[j] for j in s) / 1 [s] for i in s");
    check(n, &product, |x, _| x.iter().product());
    let range = model(n, "eq d/dt x[i] = sum(x[j] for j in 1..i) / 1 [s] for i in s");
    check(n, &range, |x, i| x[..=i].iter().sum());
}

/// Three layers of a network: each neuron is worked out once, whether it is a `let` or a `var`.
#[test]
fn sums_of_sums_are_shared() {
    let n = 20;
    for (role, layer) in [
        ("let", "let h1[i in s] = tanh(sum(W[i,j]*x[j] for j in s))\nlet h2[i in s] = tanh(sum(W[i,j]*h1[j] for j in s))"),
        (
            "var",
            "var h1[i in s]\nvar h2[i in s]\neq h1[i] = tanh(sum(W[i,j]*x[j] for j in s)) for i in s
             eq h2[i] = tanh(sum(W[i,j]*h1[j] for j in s)) for i in s",
        ),
    ] {
        let source = model(
            n,
            &format!("param W[i in s, j in s] = 0.01*i - 0.02*j\n{layer}\neq d/dt x[i] = sum(W[i,j]*h2[j] for j in s) / 1 [s] for i in s"),
        );
        check(n, &source, |x, i| {
            let w = |i: usize, j: usize| 0.01 * (i + 1) as f64 - 0.02 * (j + 1) as f64;
            let times = |x: &[f64]| (0..n).map(|i| (0..n).map(|j| w(i, j) * x[j]).sum::<f64>()).collect::<Vec<f64>>();
            let layer = |x: &[f64]| times(x).into_iter().map(f64::tanh).collect::<Vec<f64>>();
            times(&layer(&layer(x)))[i]
        });
        let model = flat(&source);
        for row in &model.rows {
            let inner = model.exprs.has_reduction(row.residual, |free| free & !1 != 0);
            assert!(!inner, "{role}: a sum inside of a sum");
        }
    }
}

#[test]
fn masses_before_derivatives() {
    for n in LENGTHS {
        let source = model(n, "eq M[i] * d/dt x[i] = (u - x[i]) / 1 [s] for i in s");
        check(n, &source, |x, i| (1.0 - x[i]) / (1.0 + 0.1 * (i + 1) as f64));
    }
}

#[test]
fn observations_of_a_whole_array_are_taken_apart() {
    let mut r = Running::new(
        "state x = 2
         var v[i in 1..2, j in 1..17]
         var w[j in 1..17, i in 1..2]
         eq v[i, j] = 100*i + j*x for i in 1..2, j in 1..17
         eq w[j, i] = v[i, j] + 0.5 for i in 1..2, j in 1..17
         eq d/dt x = v[1, 2] / 1 [s]
         observe v, w",
    );
    assert_eq!(r.model.unknowns(), 1);
    for (name, expected) in
        [("v[1,1]", 102.0), ("v[1,17]", 134.0), ("v[2,1]", 202.0), ("v[2,17]", 234.0), ("w[17,2]", 234.5), ("w[1,1]", 102.5)]
    {
        assert_close(r.observation(name), expected);
    }
}

/// Found by random models: the loop of an output over all elements is not a loop over the last index.
#[test]
fn outputs_of_arrays_with_two_loops_go_row_by_row() {
    let mut r = Running::new(
        "domain z in 0..2 cells 2
         domain r in 0..3 cells 3
         state x[i in 1..20, j in 1..20] = 1
         state y[r] = r
         var v[z, r]
         var w[i in 1..20, j in 1..20]
         var single[z]
         eq v[z, r] = y[r] + 10*z for z, r
         eq w[i, j] = 100*i + j*x[i, j] for i in 1..20, j in 1..20
         eq single[1] = y[1]
         eq single[2] = 2*y[1]
         eq d/dt y[r] = 0 for r
         eq d/dt x[i, j] = w[i, j] / 1 [s] for i in 1..20, j in 1..20
         observe v in 0..100, w in 0..3000
         observe both = sum(single[z] for z) in 0..9",
    );
    for (name, expected) in [("v[1,3]", 7.5), ("v[2,1]", 15.5), ("w[3,1]", 301.0), ("w[20,19]", 2019.0)] {
        assert_close(r.observation(name), expected);
        assert_close(r.output(name), expected);
    }
    assert_close(r.observation("both"), 1.5);
}

/// A parameter that gives the range its size cannot change, any other one can: comparisons with it are made while the model runs.
#[test]
fn comparisons_with_parameters() {
    for n in LENGTHS {
        let source = format!(
            "param n = {n}\nparam k = 3\nstate x[i in 1..n] = 0.5
             eq d/dt x[i] = ((if i < n then x[i+1] else 1) + (if i > k then 1 else 0)) / 1 [s] for i in 1..n"
        );
        let rate = |k: usize| move |x: &[f64], i: usize| x.get(i + 1).unwrap_or(&1.0) + f64::from(u8::from(i + 1 > k));
        check(n, &source, rate(3));
        let mut r = Running::new(&source);
        r.give("k", 4.0);
        let (rates, x) = (r.rates(), r.y.clone());
        (0..n).for_each(|i| assert_close(rates[i], rate(4)(&x, i)));
        let structural: Vec<bool> = r.model.interface().quantities.parameters.iter().map(|q| q.structural).collect();
        assert_eq!(structural, [true, false]);
    }
}

/// A variable over `z` with a sum over `q` in its definition, used in loops over `q` and `z`: the counter of the sum is its own.
#[test]
fn a_sum_in_a_definition_counts_for_itself() {
    let mut r = Running::new(
        "domain z in 0..1 cells 4
         domain q in 0..1 cells 3
         state d[z] = z
         state c[q] = 1 + q
         state m[q, z] = 0
         var total[z]
         eq total[z] = sum(d[z]*c[q] for q) for z
         eq d/dt d[z] = 0 for z
         eq d/dt c[q] = 0 for q
         eq d/dt m[q, z] = total[z]*c[q] / 1 [s] for q, z",
    );
    let sum: f64 = (1..=3).map(|q| r.get(&format!("c[{q}]"))).sum();
    for (q, z) in [(1, 1), (2, 4), (3, 2)] {
        let expected = r.get(&format!("d[{z}]")) * sum * r.get(&format!("c[{q}]"));
        assert_close(r.rate(&format!("m[{q},{z}]")), expected);
    }
}

#[test]
fn a_long_table_over_time_takes_no_code_of_its_length() {
    let model = |points: u32| {
        let rows: Vec<String> = (0..points).map(|i| format!("{i}: {}", 7 * i % 13)).collect();
        Running::new(&format!(
            "time t : h\ntable feed : 1 over time : h linear {{ {} }}\nstate x = 0 in 0..100\neq d/dt x = (feed(t) - x)/1 [h]",
            rows.join(", ")
        ))
    };
    let (small, large) = (model(100), model(5000));
    assert!(large.model.code_len() < small.model.code_len() + 64, "{} and {} bytes", small.model.code_len(), large.model.code_len());
}

/// A table over `s`, another over pairs, and a model of both; read at the index, next to it, from the end and in sums.
fn tables(n: usize) -> String {
    let rows = |entry: &dyn Fn(usize) -> String| (1..=n).map(|i| format!("{i}: {}\n", entry(i))).collect::<String>();
    let pairs: String = (1..=n).map(|i| format!("{i}: a = {}, b = {}\n", 1 + i % 5, 2 + i % 3)).collect();
    let tables = format!(
        "set parts = {{ a, b }}\ntable k[s] = {{\n{}}}\ntable w[s, parts] {{\n{pairs}}}\n",
        rows(&|i| format!("{}", 1 + i * i % 7))
    );
    let equations = format!(
        "eq d/dt x[i] = (sum(w[i, p] for p in parts)*x[i] - k[{n} + 1 - i] + sum(k[j]*x[j] for j in s)/k[i+1]) / 1 [s] for i in 1..{n}-1\n\
         eq d/dt x[{n}] = (-k[{n}]*x[{n}]) / 1 [s]"
    );
    model(n, &(tables + &equations))
}

#[test]
fn entries_of_tables_are_looked_up_where_a_loop_counts() {
    let k = |i: usize| (1 + i * i % 7) as f64;
    for n in LENGTHS {
        check(n, &tables(n), |x, at| {
            let (i, sum) = (at + 1, x.iter().enumerate().map(|(j, x)| k(j + 1) * x).sum::<f64>());
            let w = (1 + i % 5 + 2 + i % 3) as f64;
            if i == n { -k(n) * x[at] } else { w * x[at] - k(n + 1 - i) + sum / k(i + 1) }
        });
    }
    let (small, large) = (Running::new(&tables(20)), Running::new(&tables(200)));
    // The lengths of its loops decide how a sum is compiled; written out, each number would take some dozens of bytes.
    assert!(large.model.code_len() < small.model.code_len() + 256, "{} and {} bytes", small.model.code_len(), large.model.code_len());
}

#[test]
fn loops_across_equal_parts_read_each_by_its_own_definition() {
    for n in [6, 32, 48] {
        let half = n / 2;
        let parts = format!("var y[i in s]\neq y[i] = i*x[i] for i in 1..{half}\neq y[i] = 3 + x[i]^2 for i in {half}+1..{n}");
        let y = |x: &[f64], i: usize| if i < half { (i + 1) as f64 * x[i] } else { 3.0 + x[i] * x[i] };
        let with = |equations: &str| model(n, &format!("{parts}\n{equations}"));
        check(n, &with("eq d/dt x[i] = y[i] / 1 [s] for i in s"), |x, i| y(x, i));
        let shifted = format!("eq d/dt x[i] = y[i+1] / 1 [s] for i in 1..{n}-1\neq d/dt x[{n}] = (0 * u) as [1/s]");
        check(n, &with(&shifted), |x, i| if i + 1 < x.len() { y(x, i + 1) } else { 0.0 });
        let sum = "eq d/dt x[i] = i*sum(j*y[j] for j in 2..n-1 if j != i) / 1 [s] for i in s";
        let sum = format!("param n = {n}\n{}", with(sum));
        check(n, &sum, |x, i| (i + 1) as f64 * (1..n - 1).filter(|&j| j != i).map(|j| (j + 1) as f64 * y(x, j)).sum::<f64>());
        // Further definitions go across as well; read from the end.
        let further = format!("var z[i in s]\neq z[i] = 2*y[i] + i for i in s\neq d/dt x[i] = z[{n} + 1 - i] / 1 [s] for i in s");
        check(n, &with(&further), |x, i| 2.0 * y(x, n - 1 - i) + (n - i) as f64);
    }
}

#[test]
fn cells_across_equal_parts_read_each_by_its_own_definition() {
    let mut r = Running::new(
        "domain z in 0 [m]..1 [m] cells 10\nstate x[z] = 0.5\nvar y[z]
         eq y[z] = x[z] for z in 1..5\neq y[z] = 7 for z in 6..10\neq d/dt x[z] = y[z] / 1 [s] for z",
    );
    assert_eq!(r.model.unknowns(), 10, "only the states are unknown");
    assert_eq!(r.rates(), [[0.5; 5], [7.0; 5]].concat());
}

#[test]
fn indices_that_count_down() {
    for n in LENGTHS {
        let source = model(
            n,
            &format!(
                "eq d/dt x[i] = (x[{n} + 1 - i] - x[i] + (if {n} - i < 3 then 1 else 0)*({n} - i)) / (M[{n} + 1 - i] * 1 [s]) for i in s"
            ),
        );
        check(n, &source, |x, i| {
            let last = if n - (i + 1) < 3 { (n - i - 1) as f64 } else { 0.0 };
            (x[n - 1 - i] - x[i] + last) / (1.0 + 0.1 * (n - i) as f64)
        });
        let source =
            model(n, "eq d/dt x[i] = sum(j*x[j]*x[i-j] + (if j == i - j then u else 0) for j in 1..i-1 if i - j != 2) / 1 [s] for i in s");
        check(n, &source, |x, i| {
            let term = |j: usize| j as f64 * x[j - 1] * x[i - j] + if 2 * j == i + 1 { 1.0 } else { 0.0 };
            (1..=i).filter(|j| i + 1 - j != 2).map(term).sum()
        });
    }
}

#[test]
fn sums_up_to_an_outer_index_stay_loops() {
    let aggregation = |n: usize| {
        Running::new(&model(n, "eq d/dt x[i] = (0.5*sum(x[j]*x[i-j] for j in 1..i-1) - x[i]*sum(x[j] for j in s)) / 1 [s] for i in s"))
    };
    let (small, large) = (aggregation(50), aggregation(200));
    let ratio = large.model.code_len() as f64 / small.model.code_len() as f64;
    assert!(ratio < 8.0, "four times as many classes, {ratio} times the code: written out it would be 16");
    check(60, &model(60, "eq d/dt x[i] = sum(x[j]*x[i-j] for j in 1..i-1) / 1 [s] for i in s"), |x, i| {
        (0..i).map(|j| x[j] * x[i - 1 - j]).sum()
    });
}
