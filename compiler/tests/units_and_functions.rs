//! Values of expressions, compared with manually computed ones.

mod running;

use running::{Running, assert_close};

/// The value of an expression whose unit is `unit`, in a model with a state `x = 2` and some parameters.
fn value(unit: &str, expression: &str) -> f64 {
    let points = |value: u32| (6..50).map(|t| format!("{t}: {value}")).collect::<Vec<_>>().join(", ");
    let (flat, high) = (points(40), points(60));
    let source = format!(
        "time t : min
         set s = {{ a, b, c }}
         table k[s] = {{ a: 1, b: 2, c: 3 }}
         table m[s, s] default 0 {{
           a: b = 2
           c: a = -1
         }}
         table power[s] = {{ a: 0, b: 2, c: 1 }}
         table until_table over time : h until {{ 1: 10, 2: 20, 4: 40 }}
         table from_table over time : h from {{ 0: 10, 1: 20, 2: 40 }}
         table linear_table : L over time : h linear {{ 1: 10, 2: 20, 4: 60 }}
         table long_until over time : h until {{ 1: 10, 2: 20, 4: 40, {flat} }}
         table long_from over time : h from {{ 0: 10, 1: 20, 2: 40, {flat} }}
         table long_linear : L over time : h linear {{ 1: 10, 2: 20, 4: 60, {high} }}
         domain z in 1 [m]..3 [m] cells 4
         param V : L = 2
         param T : degC = 25
         param Q : m^3/h = 6
         param share : % = 40
         param angle : deg = 90
         param nan = 0
         param zero = 0
         state x = 2 in 0..10
         state v[s] = 1
         state c[z] : mol/m = 1
         eq d/dt x = -x / 1 [min]
         eq d/dt v[i] = -k[i] * v[i] / 1 [min] for i in s
         eq d/dt c[z] = -c[z] / 1 [min] for z
         let wanted : {unit} = {expression}"
    );
    let mut running = Running::new(&source);
    running.set("v[a]", 3.0).set("v[b]", 5.0).set("v[c]", 7.0);
    for cell in 1..=4 {
        running.set(&format!("c[{cell}]"), f64::from(cell * cell));
    }
    running.output("wanted")
}

#[test]
fn commensurable_units_convert_by_the_exact_factor() {
    assert_close(value("m^3", "V"), 0.002);
    assert_close(value("mL", "V + 1 [m^3]"), 1_002_000.0);
    assert_close(value("L/min", "Q"), 100.0);
    assert_close(value("min", "1 [h] + 30 [s]"), 60.5);
    assert_close(value("1", "V / 1 [m^3]"), 0.002);
    assert_close(value("1", "5 [%] + 1"), 1.05);
    assert_close(value("%", "x / 8"), 25.0);
    assert_close(value("L^0.5", "sqrt(2 [m^3])"), 2000_f64.sqrt());
    assert_close(value("kg", "1 [t] + 1 [g]"), 1000.001);
    assert_close(value("rad", "180 [deg]"), std::f64::consts::PI);
}

/// A number alone in a branch of an `if` is taken in the declared unit, as it is without the `if`; elsewhere next to a quantity it is dimensionless.
#[test]
fn numbers_beside_percentages_and_angles_mean_one_thing() {
    assert_close(value("%", "if x > 5 then 100 else share"), 40.0);
    assert_close(value("%", "if x < 5 then 100 else share"), 100.0);
    assert_close(value("%", "if x > 5 then share else 100"), 100.0);
    assert_close(value("%", "if x > 5 then 7 else if x > 4 then 100 else share"), 40.0);
    assert_close(value("deg", "if x > 5 then 1 else angle"), 90.0);
    assert_close(value("ppm", "if x > 5 then 1 else share"), 400_000.0);
    assert_close(value("1", "if x > 5 then 100 else share"), 0.4);
    assert_close(value("%", "1 - share"), 60.0);
    assert_close(value("%", "max(0.3, share)"), 40.0);
    assert_close(value("%", "max(share, 0.3)"), 40.0);
    assert_close(value("%", "max(0.5, share)"), 50.0);
    assert_close(value("%", "min(1, share)"), 40.0);
    assert_close(value("%", "clip(share, 0.5, 1)"), 50.0);
    assert_close(value("%", "mod(1, share)"), 20.0);
}

/// A function of pure numbers is a dimensionless quantity, of constants as of variables (x is 2): no number of the unit that a place
/// declares.
#[test]
fn functions_of_constants_are_dimensionless_quantities() {
    assert_close(value("deg", "asin(0.5)"), 30.0);
    assert_close(value("deg", "asin(0.25 * x)"), 30.0);
    assert_close(value("deg", "atan2(1, 1)"), 45.0);
    assert_close(value("%", "exp(-0.5)"), 60.653_065_971_263_34);
    assert_close(value("%", "exp(-0.25 * x)"), 60.653_065_971_263_34);
    assert_close(value("%", "1 - exp(-0.5)"), 39.346_934_028_736_66);
    assert_close(value("%", "sqrt(2 * cosh(0) + 2)"), 200.0);
    // Branch by branch.
    assert_close(value("deg", "if x > 5 then 5 else asin(0.5)"), 30.0);
    assert_close(value("deg", "if x < 5 then 5 else asin(0.5)"), 5.0);
    // The number of degrees stays the number of degrees.
    assert_close(value("deg", "sqrt(900) + abs(-5) * 2^2 - clip(7, 0, 5)"), 45.0);
    // Half a turn, as `acos(-1)`.
    assert_close(value("deg", "pi / 2"), 90.0);
    assert_close(value("%", "e"), 271.828_182_845_904_5);
    assert_close(value("%", "value(share) + 1"), 41.0);
    // A sign, and a power with a quantity as exponent, are of that quantity.
    assert_close(value("%", "sign(-x)"), -100.0);
    assert_close(value("%", "2^x"), 400.0);
}

/// The same where other statements declare a unit.
#[test]
fn functions_of_constants_are_dimensionless_wherever_a_unit_is_declared() {
    let mut r = Running::new(
        "table tilt[s] : deg = { a: asin(0.5), b: 5 }
         set s = { a, b }
         param p : deg = asin(0.5)
         action u : deg = asin(0.5) in 0..90
         state x : deg = 7 in 0..90
         state y = 1
         discrete d : % = 3
         initial x = asin(0.5)
         initial d = exp(-0.5)
         eq d/dt x = 0
         eq d/dt y = (tilt[a] + p - y) / 1 [s]
         let shown : deg = tilt[a]
         observe seen : deg = if y > 5 then 5 else asin(0.5) in 0..90
         observe kept : deg = if y < 5 then 5 else asin(0.5) in 0..90
         reward r : % default = if y > 5 then 5 else exp(-0.5)
         policy level { u = asin(0.5) }",
    );
    assert_close(r.parameter("p"), 30.0);
    assert_close(r.get("x"), 30.0);
    assert_close(r.output("shown"), 30.0);
    assert_close(r.model.interface().quantities.actions[0].default[0], 30.0);
    assert_close(r.reward(0), 60.653_065_971_263_34);
    assert_close(r.observation("seen"), 30.0);
    assert_close(r.observation("kept"), 5.0);
}

/// A ratio without a declared unit is shown as the number: 1 bar are 100 kPa.
#[test]
fn ratios_are_observed_as_numbers() {
    let mut r = Running::new(
        "set s = { a, b }
         state x : bar = 1 in 0..5
         state v[s] : bar = 2 in 0..5
         eq d/dt x = 0
         eq d/dt v[i] = 0 for i in s
         let ratio[i in s] = v[i] / 1 [kPa]
         param share : % = 40
         observe e = x / (1 [kPa]) in 0..500
         observe ratio in 0..500
         observe kept = 2 * share in 0..500
         observe asked : % = x / 4 [bar] in 0..500",
    );
    assert_close(r.observation("e"), 100.0);
    assert_close(r.observation("ratio[b]"), 200.0);
    assert_close(r.observation("kept"), 80.0);
    assert_close(r.observation("asked"), 25.0);
    let units: Vec<&str> = r.model.interface().finish.observations.iter().map(|o| o.unit.as_str()).collect();
    assert_eq!(units, ["1", "1", "1", "%", "%"]);
}

#[test]
fn temperatures_are_points_and_differences() {
    assert_close(value("K", "kelvin(T)"), 298.15);
    assert_close(value("K", "T - 20 [degC]"), 5.0);
    assert_close(value("K", "212 [degF] - 0 [degC]"), 100.0);
    assert_close(value("degC", "T + 5 [K]"), 30.0);
    assert_close(value("degC", "max(T, 86 [degF])"), 30.0);
    assert_close(value("1", "if T > 50 [degF] then 1 else 2"), 1.0);
    assert_close(value("1", "value(T)"), 25.0);
    assert_close(value("1", "value(kelvin(T), degC)"), 25.0);
    assert_close(value("1", "value(T, degF)"), 77.0);
    assert_close(value("1", "value(kelvin(T))"), 298.15);
}

#[test]
fn a_unit_is_taken_off_and_put_on() {
    assert_close(value("1", "value(V)"), 2.0);
    assert_close(value("1", "value(V, mL)"), 2000.0);
    assert_close(value("1/h", "(0.5 * value(T)) as [1/h]"), 12.5);
    assert_close(value("1/h", "(0.5 as [1/min])"), 30.0);
    assert_close(value("m^3", "V as [mL]"), 0.002);
    assert_close(value("mol/m", "1e-3 [unit(c[1])]"), 1e-3);
}

#[test]
fn a_bare_number_fits_zero_only() {
    assert_close(value("L", "if V > 0 then V else 0"), 2.0);
    assert_close(value("L", "max(V, 0)"), 2.0);
    assert_close(value("L", "clip(V, 0, 1 [L])"), 1.0);
}

#[test]
fn powers_bind_to_the_right_and_before_the_sign() {
    assert_close(value("1", "-x^2"), -4.0);
    assert_close(value("1", "2^x^3"), 256.0);
    assert_close(value("1", "x^-1"), 0.5);
    assert_close(value("1", "(-x)^3"), -8.0);
    assert_close(value("1", "8 / 2 / x"), 2.0);
    assert_close(value("1", "8 - 2 - x"), 4.0);
}

#[test]
fn reductions_run_over_sets_tuples_and_cells() {
    assert_close(value("1", "sum(k[i] * v[i] for i in s)"), 34.0);
    assert_close(value("1", "sum(v[i] for i in s if i != b)"), 10.0);
    assert_close(value("1", "sum(m[i, j] * v[j] for i in s, j in s)"), 7.0);
    assert_close(value("1", "product(v[i]^power[i] for i in s)"), 175.0);
    assert_close(value("1", "min(v[i] for i in s) + 10 * max(v[i] for i in s)"), 73.0);
    assert_close(value("1", "mean(v[i] for i in s)"), 5.0);
    assert_close(value("1", "mean(v[i] for i in s if v[i] > 4)"), 6.0);
    assert_close(value("1", "sum(q for q in (x, v[a], 4))"), 9.0);
    assert_close(value("1", "sum(max(q for q in (x, v[i], k[i] + 4)) for i in s)"), 18.0);
    assert_close(value("1", "if any(v[i] > 6 for i in s) and not all(v[i] > 6 for i in s) then 1 else 0"), 1.0);
    assert_close(value("1", "sum(i for i in 1..4)"), 10.0);
    assert_close(value("1", "sum(1 for i in 3..2)"), 0.0);
    assert_close(value("mol/m", "sum(c[z] for z)"), 30.0);
    assert_close(value("mol/m", "max(c[z] for z in 2..z.last-1)"), 9.0);
    assert_close(value("mol/m", "mean(c[z] for z)"), 7.5);
    assert_close(value("mol", "integral(c[z] for z)"), 15.0);
    assert_close(value("m", "max(z for z)"), 2.75);
    assert_close(value("m", "sum(width(z) for z)"), 2.0);
    assert_close(value("mol/m", "c[z.first] + c[z.last] + c[2]"), 21.0);
    assert_close(value("1", "if any(c[z] > 15 [mol/m] for z) then 1 else 0"), 1.0);
    assert_close(value("1", "if all(c[z] > 1 [mol/m] for z) then 1 else 0"), 0.0);
    assert_close(value("1", "z.cells + z.last - z.first"), 7.0);
    assert_close(value("1", "sum(1 for z if c[z] > 3 [mol/m])"), 3.0);
    assert_close(value("1", "sum(sum(i * j for j in 1..i) for i in 1..3)"), 25.0);
}

#[test]
fn states_stand_for_all_of_them() {
    assert_close(value("1", "sum(value(q) for q in states)"), 2.0 + 15.0 + 30.0);
    assert_close(value("1", "sum(1 for q in states)"), 8.0);
}

#[test]
fn a_zero_power_of_a_zero_base_vanishes() {
    assert_close(value("1", "product((x - 2)^power[i] for i in s if i == a)"), 1.0);
}

#[test]
fn tables_over_time_hold_at_their_boundaries() {
    for (time, until, from, linear) in [
        ("0 [h]", 10.0, 10.0, 10.0),
        ("0.5 [h]", 10.0, 10.0, 10.0),
        ("1 [h]", 10.0, 20.0, 10.0),
        ("61 [min]", 20.0, 20.0, 10.0 + 10.0 / 60.0),
        ("2 [h]", 20.0, 40.0, 20.0),
        ("3 [h]", 40.0, 40.0, 40.0),
        ("4 [h]", 40.0, 40.0, 60.0),
        ("5 [h]", 40.0, 40.0, 60.0),
    ] {
        assert_close(value("1", &format!("until_table({time} + x*0 [h])")), until);
        assert_close(value("1", &format!("from_table({time} + x*0 [h])")), from);
        assert!((value("L", &format!("linear_table({time} + x*0 [h])")) - linear).abs() < 1e-12, "{time}");
        // Long enough to be searched.
        assert_close(value("1", &format!("long_until({time} + x*0 [h])")), until);
        assert_close(value("1", &format!("long_from({time} + x*0 [h])")), from);
        assert!((value("L", &format!("long_linear({time} + x*0 [h])")) - linear).abs() < 1e-12, "{time}");
    }
}

#[test]
fn not_a_number_comes_through() {
    assert!(value("1", "clip(zero / nan * x, 0, 1)").is_nan());
    assert!(value("1", "min(zero / nan * x, 1)").is_nan());
    assert!(value("1", "max(1, zero / nan * x)").is_nan());
}

#[test]
fn attributes_are_those_declared() {
    assert_close(value("1", "high(x) - low(x) + scale(x)"), 20.0);
    assert_close(value("1", "nominal(x)"), 2.0);
}

#[test]
fn rounding_and_signs() {
    assert_close(value("1", "floor(2.7) + 10*ceil(2.2) + 100*round(2.5 + 0*x)"), 232.0);
    assert_close(value("1", "sign(-x) + abs(-x)"), 1.0);
    assert_close(value("L", "abs(-V)"), 2.0);
    assert_close(value("1", "atan2(1, 1)"), std::f64::consts::FRAC_PI_4);
    assert_close(value("1", "ln(e) + log10(100) + exp(0)"), 4.0);
}

/// A ratio is a number, whatever the units that it is a ratio of.
#[test]
fn ratios_are_rounded_as_numbers() {
    // Q is 100 L/min, V 2 L, x 2.
    assert_close(value("1", "floor(Q / 30 [L/h])"), 200.0);
    assert_close(value("1", "floor(x * 50 [min] / 1 [h])"), 1.0);
    assert_close(value("1", "ceil(x * 50 [min] / 1 [h])"), 2.0);
    assert_close(value("1", "round(V / 0.75 [m^3] * 1000)"), 3.0);
    assert_close(value("1", "floor(4 * share)"), 1.0);
    assert_close(value("1", "round(share * 4e6 [ppm])"), 2.0);
    assert_close(value("m", "1 [m] * round(x * 1 [ft] / 35 [cm])"), 2.0);
    assert_close(value("1", "single(V / 0.6 [mL])"), f64::from(3_333.333_3_f32));
    assert_close(value("%", "round(share / 7 [%]) * 7 [%]"), 42.0);
    assert_close(value("1", "value(x * 50 [min] / 1 [h])"), 100.0 / 60.0);
    assert_close(value("1", "value(share)"), 40.0);
    assert_close(value("1", "value(2 * V)"), 4.0);
    assert_close(value("1", "value(Q / 1 [L/min])"), 100.0);
    assert_close(value("1", "value(Q * 1 [h], L)"), 6000.0);
    // What has a dimension is rounded in the unit that the text names.
    assert_close(value("L", "floor(V + 0.7 [L])"), 2.0);
    assert_close(value("m^3/h", "round(1.13 * Q)"), 7.0);
}

#[test]
fn conditions_choose() {
    assert_close(value("1", "if x > 1 and x < 3 then 1 else if x > 5 then 2 else 3"), 1.0);
    assert_close(value("1", "if not (x > 1) or x >= 2 then 1 else 0"), 1.0);
    assert_close(value("min", "if x > 1 then 1 [h] else 2 [min]"), 60.0);
}

#[test]
fn random_numbers_have_their_mean_where_a_number_is_asked_for() {
    let r = Running::new(
        "param a = 1 ~ uniform(2, 4)
         param b = 3 * a
         state x = 1
         eq d/dt x = (b - x) / 1 [s]",
    );
    // The draws of a fresh memory are zero: the lower end of the uniform distribution.
    assert_close(r.parameter("a"), 2.0);
    assert_close(r.parameter("b"), 6.0);
}

#[test]
fn parameters_are_computed_in_the_order_of_need() {
    let r = Running::new(
        "param d = c + b
         param c = 2 * b
         param b = a^2
         param a = 3
         state x = 1
         eq d/dt x = (d - x) / 1 [s]",
    );
    assert_close(r.parameter("d"), 27.0);
}

#[test]
fn elements_of_a_parameter_may_need_each_other() {
    let r = Running::new(
        "set s = { a, b }
         param p[i in s] = if i == a then 2 else 3 * p[a]
         state x = 1
         eq d/dt x = (p[b] - x) / 1 [s]",
    );
    assert_close(r.parameter("p[b]"), 6.0);
}
