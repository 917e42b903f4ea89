//! Cells of one domain as indices of arrays over another, by their numbers.

mod running;

use running::{Running, assert_close};

#[test]
fn a_cell_is_taken_by_its_number() {
    let mut r = Running::new(
        "domain z in 0 [m]..1 [m] cells 6
         domain longer in 0 [m]..3 [m] cells 5
         state T[z] = 0
         state a[longer] = 0
         eq d/dt T[z] = -T[z] * z.number / 1 [s] for z
         eq d/dt a[longer] = (T[longer.number] - 10*T[longer.number + 1] + a[longer]*longer.number) / 1 [s] for longer",
    );
    let (t, a) = (|k: usize| 0.3 + (k as f64).sin(), |k: usize| (k as f64).cos());
    for k in 1..=6 {
        r.set(&format!("T[{k}]"), t(k));
    }
    for k in 1..=5 {
        r.set(&format!("a[{k}]"), a(k));
    }
    let rates = r.rates();
    (1..=6).for_each(|k| assert_close(rates[k - 1], -t(k) * k as f64));
    (1..=5).for_each(|k| assert_close(rates[5 + k], t(k) - 10.0 * t(k + 1) + a(k) * k as f64));
}
