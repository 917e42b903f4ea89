//! Slopes of interpolating polynomials at their points.

/// Differences of neighbours.
fn steps(x: &[f64]) -> Vec<f64> {
    x.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// Slopes of the lines between points.
fn secants(x: &[f64], y: &[f64]) -> Vec<f64> {
    steps(x).iter().zip(steps(y)).map(|(h, rise)| rise / h).collect()
}

/// Slopes of the monotone cubic interpolant (PCHIP of Fritsch and Butland): weighted harmonic means
/// of the neighbouring secants, zero at extrema, and limited one-sided three-point formulas at the
/// ends.
pub(in crate::elaborate) fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let (h, m) = (steps(x), secants(x, y));
    match m.as_slice() {
        [] => return vec![0.0; x.len()],
        [m] => return vec![*m; 2],
        _ => {}
    }
    let inner = |k: usize| {
        if m[k - 1] * m[k] <= 0.0 {
            return 0.0;
        }
        let (w1, w2) = (2.0 * h[k] + h[k - 1], h[k] + 2.0 * h[k - 1]);
        (w1 + w2) / (w1 / m[k - 1] + w2 / m[k])
    };
    let end = |h0: f64, h1: f64, m0: f64, m1: f64| {
        let slope = ((2.0 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
        if slope * m0 <= 0.0 {
            0.0
        } else if m0 * m1 <= 0.0 && slope.abs() > 3.0 * m0.abs() {
            3.0 * m0
        } else {
            slope
        }
    };
    let last = m.len() - 1;
    let first = end(h[0], h[1], m[0], m[1]);
    let middle = (1..=last).map(inner);
    std::iter::once(first).chain(middle).chain([end(h[last], h[last - 1], m[last], m[last - 1])]).collect()
}

/// Slopes of the cubic spline whose third derivative is continuous at the second and the last but
/// one point ("not a knot").
pub(in crate::elaborate) fn spline_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let (h, m) = (steps(x), secants(x, y));
    let n = x.len();
    match m.as_slice() {
        [] => return vec![0.0; n],
        [m] => return vec![*m; 2],
        // A parabola.
        [a, b] => {
            let curvature = (b - a) / (h[0] + h[1]);
            return vec![a - curvature * h[0], a + curvature * h[0], b + curvature * h[1]];
        }
        _ => {}
    }
    let (mut lower, mut diagonal, mut upper, mut right) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for i in 1..n - 1 {
        (lower[i], diagonal[i], upper[i]) = (h[i], 2.0 * (h[i - 1] + h[i]), h[i - 1]);
        right[i] = 3.0 * (h[i] * m[i - 1] + h[i - 1] * m[i]);
    }
    let end = |h0: f64, h1: f64, m0: f64, m1: f64| ((h0 + 2.0 * (h0 + h1)) * h1 * m0 + h0 * h0 * m1) / (h0 + h1);
    let k = n - 2;
    (diagonal[0], upper[0], right[0]) = (h[1], h[0] + h[1], end(h[0], h[1], m[0], m[1]));
    (diagonal[n - 1], lower[n - 1], right[n - 1]) = (h[k - 1], h[k] + h[k - 1], end(h[k], h[k - 1], m[k], m[k - 1]));
    for i in 1..n {
        let factor = lower[i] / diagonal[i - 1];
        diagonal[i] -= factor * upper[i - 1];
        right[i] -= factor * right[i - 1];
    }
    let mut slopes = vec![0.0; n];
    for i in (0..n).rev() {
        let above = if i + 1 < n { upper[i] * slopes[i + 1] } else { 0.0 };
        slopes[i] = (right[i] - above) / diagonal[i];
    }
    slopes
}

/// Coefficients of the polynomial between two points, by powers of the distance from the first.
pub(in crate::elaborate) fn hermite(h: f64, [y0, y1]: [f64; 2], [d0, d1]: [f64; 2]) -> [f64; 4] {
    let m = (y1 - y0) / h;
    [y0, d0, (3.0 * m - 2.0 * d0 - d1) / h, (d0 + d1 - 2.0 * m) / (h * h)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spline_gives_a_cubic_back() {
        let x = [0.0, 0.7, 1.0, 2.5, 4.0];
        let y = x.map(|x: f64| 1.0 - 2.0 * x + 0.5 * x * x * x);
        for (slope, x) in spline_slopes(&x, &y).into_iter().zip(x) {
            assert!((slope - (1.5 * x * x - 2.0)).abs() < 1e-12);
        }
        let parabola = spline_slopes(&[0.0, 1.0, 3.0], &[0.0, 1.0, 9.0]);
        assert_eq!(parabola, [0.0, 2.0, 6.0]);
    }

    #[test]
    fn monotone_slopes_agree_with_scipy() {
        // scipy.interpolate.PchipInterpolator([0, 1, 3, 4, 7], [0, 2, 3, 3, 1]).derivative()(x),
        // SciPy 1.17.1.
        let found = monotone_slopes(&[0.0, 1.0, 3.0, 4.0, 7.0], &[0.0, 2.0, 3.0, 3.0, 1.0]);
        for (found, expected) in found.into_iter().zip([2.5, 0.8571428571428571, 0.0, 0.0, -1.1666666666666665]) {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }
}
