//! Published test problems, shared by tests and benchmarks.

use super::{Pattern, System};

/// F(t, y, y', u), written to the last argument.
pub type Residual = fn(f64, &[f64], &[f64], &[f64], &mut [f64]);

/// ∂F/∂y + c ∂F/∂y' of (t, y, c, u), written to the last argument in the pattern's order.
pub type Jacobian = fn(f64, &[f64], f64, &[f64], &mut [f64]);

/// A system whose equations are Rust functions.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Initial values.
    pub start: Vec<f64>,
    /// Inputs or parameters, which may be changed between an advance and a restart.
    pub inputs: Vec<f64>,
    differential: Vec<bool>,
    explicit: bool,
    autonomous: bool,
    pattern: Pattern,
    residual: Residual,
    jacobian: Jacobian,
}

impl Problem {
    /// A system of ordinary differential equations, F = f − y', with this pattern.
    pub fn ode(start: Vec<f64>, inputs: Vec<f64>, pattern: Pattern, residual: Residual, jacobian: Jacobian) -> Self {
        let differential = vec![true; start.len()];
        Self { start, inputs, differential, explicit: true, autonomous: false, pattern, residual, jacobian }
    }

    /// The same without time in its functions.
    pub(crate) fn autonomous(mut self) -> Self {
        self.autonomous = true;
        self
    }

    /// The same functions, with these unknowns differential and derivatives explicit or not.
    pub fn with_structure(mut self, differential: Vec<bool>, explicit: bool) -> Self {
        self.differential = differential;
        self.explicit = explicit;
        self
    }
}

impl System for Problem {
    fn differential(&self) -> &[bool] {
        &self.differential
    }

    fn is_explicit(&self) -> bool {
        self.explicit
    }

    fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    fn forcing_count(&self) -> usize {
        if self.autonomous { 0 } else { self.differential.len() }
    }

    fn depends_on_time(&self) -> bool {
        !self.autonomous
    }

    fn residual(&mut self, t: f64, y: &[f64], yp: &[f64], out: &mut [f64]) {
        (self.residual)(t, y, yp, &self.inputs, out);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], _yp: &[f64], cj: f64, values: &mut [f64]) {
        (self.jacobian)(t, y, cj, &self.inputs, values);
    }
}

/// Robertson's chemical kinetics as ordinary differential equations: three unknowns, rates over
/// nine decades.
///
/// H. H. Robertson, The solution of a set of reaction rate equations, in *Numerical Analysis*
/// (Academic Press, 1966).
pub fn robertson() -> Problem {
    Problem::ode(
        vec![1.0, 0.0, 0.0],
        vec![],
        Pattern::full(3),
        |_, y, yp, _, out| {
            let (slow, middle, fast) = (0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] * y[1]);
            out[0] = -slow + middle - yp[0];
            out[1] = slow - middle - fast - yp[1];
            out[2] = fast - yp[2];
        },
        |_, y, cj, _, j| {
            let (y2, y3) = (y[1], y[2]);
            j.copy_from_slice(&[-0.04 - cj, 0.04, 0.0, 1e4 * y3, -1e4 * y3 - 6e7 * y2 - cj, 6e7 * y2, 1e4 * y2, -1e4 * y2, -cj]);
        },
    )
    .autonomous()
}

/// Robertson's problem with the balance y₁ + y₂ + y₃ = 1 instead of the third rate: one algebraic
/// unknown.
pub fn robertson_dae() -> Problem {
    let mut problem = robertson().with_structure(vec![true, true, false], true);
    problem.residual = |_, y, yp, _, out| {
        let (slow, middle, fast) = (0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] * y[1]);
        out[0] = -slow + middle - yp[0];
        out[1] = slow - middle - fast - yp[1];
        out[2] = y[0] + y[1] + y[2] - 1.0;
    };
    problem.jacobian = |_, y, cj, _, j| {
        let (y2, y3) = (y[1], y[2]);
        j.copy_from_slice(&[-0.04 - cj, 0.04, 1.0, 1e4 * y3, -1e4 * y3 - 6e7 * y2 - cj, 1.0, 1e4 * y2, -1e4 * y2, 1.0]);
    };
    problem
}

/// Van der Pol's oscillator as in the *Test Set for IVP Solvers*: ε y₂' = (1 − y₁²) y₂ − y₁ with ε
/// = 1e-6.
pub fn van_der_pol() -> Problem {
    Problem::ode(
        vec![2.0, 0.0],
        vec![1e-6],
        Pattern::full(2),
        |_, y, yp, u, out| {
            out[0] = y[1] - yp[0];
            out[1] = ((1.0 - y[0] * y[0]) * y[1] - y[0]) / u[0] - yp[1];
        },
        |_, y, cj, u, j| {
            j.copy_from_slice(&[-cj, (-2.0 * y[0] * y[1] - 1.0) / u[0], 1.0, (1.0 - y[0] * y[0]) / u[0] - cj]);
        },
    )
    .autonomous()
}

/// HIRES, eight unknowns of plant physiology, as in the *Test Set for IVP Solvers*.
pub fn hires() -> Problem {
    Problem::ode(
        vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057],
        vec![],
        Pattern::full(8),
        |_, y, yp, _, out| {
            let bound = 280.0 * y[5] * y[7];
            let rates = [
                -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
                1.71 * y[0] - 8.75 * y[1],
                -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
                8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
                -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
                -bound + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
                bound - 1.81 * y[6],
                -bound + 1.81 * y[6],
            ];
            (0..8).for_each(|i| out[i] = rates[i] - yp[i]);
        },
        |_, y, cj, _, j| {
            let (b5, b7) = (280.0 * y[7], 280.0 * y[5]);
            let columns = [
                [-1.71, 1.71, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [0.43, -8.75, 0.0, 8.32, 0.0, 0.0, 0.0, 0.0],
                [8.32, 0.0, -10.03, 1.71, 0.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.43, -1.12, 0.0, 0.69, 0.0, 0.0],
                [0.0, 0.0, 0.035, 0.0, -1.745, 1.71, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0, 0.43, -b5 - 0.43, b5, -b5],
                [0.0, 0.0, 0.0, 0.0, 0.43, 0.69, -1.81, 1.81],
                [0.0, 0.0, 0.0, 0.0, 0.0, -b7, b7, -b7],
            ];
            j.copy_from_slice(columns.as_flattened());
            (0..8).for_each(|i| j[i * 9] -= cj);
        },
    )
    .autonomous()
}

/// An exothermic stirred tank: concentration (kmol/m³), temperature (K), level (m); inputs are the
/// coolant's temperature (K) and the outflow (m³/min); time in minutes.
///
/// G. Pannocchia and J. B. Rawlings, Disturbance models for offset-free model-predictive control,
/// *AIChE J.* 49 (2003), table 2. The start is its steady state.
pub fn stirred_tank() -> Problem {
    const FEED: f64 = 0.1;
    const AREA: f64 = std::f64::consts::PI * 0.219 * 0.219;
    const HEAT_CAPACITY: f64 = 1000.0 * 0.239;
    const HEAT: f64 = 5e4 / HEAT_CAPACITY;
    const COOLING: f64 = 2.0 * 54.94 / (0.219 * HEAT_CAPACITY);
    const ACTIVATION: f64 = 8750.0;
    fn rate(temperature: f64) -> f64 {
        7.2e10 * (-ACTIVATION / temperature).exp()
    }
    Problem::ode(
        vec![0.878, 324.5, 0.659],
        vec![300.0, FEED],
        Pattern::full(3),
        |_, y, yp, u, out| {
            let dilution = FEED / (AREA * y[2]);
            let reaction = rate(y[1]) * y[0];
            out[0] = dilution * (1.0 - y[0]) - reaction - yp[0];
            out[1] = dilution * (350.0 - y[1]) + HEAT * reaction + COOLING * (u[0] - y[1]) - yp[1];
            out[2] = (FEED - u[1]) / AREA - yp[2];
        },
        |_, y, cj, _, j| {
            let dilution = FEED / (AREA * y[2]);
            let k = rate(y[1]);
            let slope = k * y[0] * ACTIVATION / (y[1] * y[1]);
            j.copy_from_slice(&[
                -dilution - k - cj,
                HEAT * k,
                0.0,
                -slope,
                -dilution + HEAT * slope - COOLING - cj,
                0.0,
                -dilution / y[2] * (1.0 - y[0]),
                -dilution / y[2] * (350.0 - y[1]),
                -cj,
            ]);
        },
    )
    .autonomous()
}

/// A satellite about the earth and the moon that comes back to where it was: Arenstorf's orbit, in
/// four unknowns (positions, velocities), rotating with the moon. Its period is
/// 17.0652165601579625.
///
/// E. Hairer, S. P. Nørsett and G. Wanner, *Solving Ordinary Differential Equations I*, 2nd edition
/// (Springer, 1993), equations (0.1) and (0.2).
pub fn arenstorf() -> Problem {
    const MOON: f64 = 0.012_277_471;
    const EARTH: f64 = 1.0 - MOON;
    /// Distances from earth and moon, to the third power, and to the fifth.
    fn powers(y: &[f64]) -> ([f64; 2], [f64; 2]) {
        let squares = [MOON, -EARTH].map(|at| (y[0] + at).powi(2) + y[1] * y[1]);
        (squares.map(|s| s * s.sqrt()), squares.map(|s| s * s * s.sqrt()))
    }
    Problem::ode(
        vec![0.994, 0.0, 0.0, -2.001_585_106_379_082_5],
        vec![],
        Pattern::full(4),
        |_, y, yp, _, out| {
            let ([earth, moon], _) = powers(y);
            let rates = [
                y[2],
                y[3],
                y[0] + 2.0 * y[3] - EARTH * (y[0] + MOON) / earth - MOON * (y[0] - EARTH) / moon,
                y[1] - 2.0 * y[2] - EARTH * y[1] / earth - MOON * y[1] / moon,
            ];
            (0..4).for_each(|i| out[i] = rates[i] - yp[i]);
        },
        |_, y, cj, _, j| {
            let ([earth3, moon3], [earth5, moon5]) = powers(y);
            let (to_earth, to_moon) = (y[0] + MOON, y[0] - EARTH);
            let rest = 1.0 - EARTH / earth3 - MOON / moon3;
            let xx = rest + 3.0 * (EARTH * to_earth * to_earth / earth5 + MOON * to_moon * to_moon / moon5);
            let xy = 3.0 * y[1] * (EARTH * to_earth / earth5 + MOON * to_moon / moon5);
            let yy = rest + 3.0 * y[1] * y[1] * (EARTH / earth5 + MOON / moon5);
            let columns = [[-cj, 0.0, xx, xy], [0.0, -cj, xy, yy], [1.0, 0.0, -cj, -2.0], [0.0, 1.0, 2.0, -cj]];
            j.copy_from_slice(columns.as_flattened());
        },
    )
    .autonomous()
}

/// Lotka's and Volterra's predators and prey: x' = x (1 − y), y' = y (x − 1), along which x + y −
/// ln(x y) stays.
pub fn predator_prey() -> Problem {
    Problem::ode(
        vec![3.0, 0.5],
        vec![],
        Pattern::full(2),
        |_, y, yp, _, out| out.copy_from_slice(&[y[0] * (1.0 - y[1]) - yp[0], y[1] * (y[0] - 1.0) - yp[1]]),
        |_, y, cj, _, j| j.copy_from_slice(&[1.0 - y[1] - cj, y[1], -y[0], y[0] - 1.0 - cj]),
    )
    .autonomous()
}

/// Tanks in series, yᵢ' = n (yᵢ₋₁ − yᵢ) with inlet `inputs[0]`, empty at the start: linear
/// advection over unit length and time. A step at the inlet leaves tank i as the distribution
/// function of Erlang's distribution.
pub fn tanks_in_series(tanks: usize) -> Problem {
    let column = |i: usize| {
        if i + 1 < tanks { vec![i, i + 1] } else { vec![i] }
    };
    Problem::ode(
        vec![0.0; tanks],
        vec![1.0],
        pattern(tanks, column),
        |_, y, yp, u, out| {
            let flow = y.len() as f64;
            let mut inlet = u[0];
            for ((out, &y), &yp) in out.iter_mut().zip(y).zip(yp) {
                *out = flow * (inlet - y) - yp;
                inlet = y;
            }
        },
        |_, y, cj, _, j| {
            let flow = y.len() as f64;
            for entries in j.chunks_mut(2) {
                entries[0] = -flow - cj;
                entries[1..].fill(flow);
            }
        },
    )
    .autonomous()
}

/// Unknowns in a cell of [`tubular_reactor`].
const SPECIES: usize = 4;

/// A tubular reactor by upwind cells, A + B → C with heat of reaction: four unknowns a cell (A, B,
/// C, temperature), one exponential a cell, all dimensionless. `inputs` are the inlet's temperature
/// and the wall's.
pub fn tubular_reactor(cells: usize) -> Problem {
    let column = |unknown: usize| {
        let (cell, species) = (unknown / SPECIES, unknown % SPECIES);
        let mut rows: Vec<usize> = match species {
            2 => vec![unknown],
            _ => (cell * SPECIES..(cell + 1) * SPECIES).collect(),
        };
        if cell + 1 < cells {
            rows.push(unknown + SPECIES);
        }
        rows
    };
    Problem::ode(
        [0.0, 0.0, 0.0, 1.0].repeat(cells),
        vec![1.0, 1.0],
        pattern(cells * SPECIES, column),
        |_, y, yp, u, out| {
            let flow = (y.len() / SPECIES) as f64;
            let mut inlet = [1.0, 0.8, 0.0, u[0]];
            for ((out, y), yp) in out.chunks_exact_mut(SPECIES).zip(y.chunks_exact(SPECIES)).zip(yp.chunks_exact(SPECIES)) {
                let rate = 8.0 * (10.0 * (1.0 - 1.0 / y[3])).exp() * y[0] * y[1];
                let source = [-rate, -rate, rate, 0.3 * rate + 2.0 * (u[1] - y[3])];
                for k in 0..SPECIES {
                    out[k] = flow * (inlet[k] - y[k]) + source[k] - yp[k];
                }
                inlet.copy_from_slice(y);
            }
        },
        |_, y, cj, _, j| {
            let cells = y.len() / SPECIES;
            let flow = cells as f64;
            let mut to = 0;
            for (cell, y) in y.chunks_exact(SPECIES).enumerate() {
                let k = 8.0 * (10.0 * (1.0 - 1.0 / y[3])).exp();
                let slopes = [k * y[1], k * y[0], 0.0, k * y[0] * y[1] * 10.0 / (y[3] * y[3])];
                for (species, slope) in slopes.into_iter().enumerate() {
                    let mut column = [-slope, -slope, slope, 0.3 * slope];
                    column[species] -= flow + cj + if species == 3 { 2.0 } else { 0.0 };
                    let rows = if species == 2 { &column[2..3] } else { &column[..] };
                    j[to..to + rows.len()].copy_from_slice(rows);
                    to += rows.len();
                    if cell + 1 < cells {
                        j[to] = flow;
                        to += 1;
                    }
                }
            }
        },
    )
    .autonomous()
}

/// The pattern whose columns have these rows.
fn pattern(dimension: usize, column: impl Fn(usize) -> Vec<usize>) -> Pattern {
    let (mut starts, mut rows) = (vec![0], vec![]);
    for i in 0..dimension {
        rows.extend(column(i));
        starts.push(rows.len());
    }
    Pattern::new(starts, rows).unwrap_or_else(|_| Pattern::full(dimension))
}
