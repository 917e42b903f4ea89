//! Starts of episodes: algebraic unknowns and states that conditions at the start determine.
//!
//! The unknowns are solved for block by block, strongly connected components of the equations in
//! their order. Each block is tried by Newton's method from its guess, inside of its bounds, from
//! other guesses, by homotopy and by least squares. The same tries in the same order give the same
//! result each time. A block without a solution is reported with its unknowns, its equations and
//! all that was tried.

mod blocks;
mod choice;
mod pivots;
mod problem;
mod report;
mod search;
mod trail;

use crate::catalogue::Catalogue;
use crate::interrupt::Pace;
use crate::system::CompiledSystem;
use blocks::Block;
pub use choice::{Conflict, Freed};
use problem::Problem;
pub use report::{StartEquation, StartFailure, StartUnknown};
use search::{Search, SearchEnd};
use smpl_dsl::diagnostic::SourceMap;
pub use trail::Tried;

/// Reason why there is no start.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum StartError {
    /// A block has no solution that was found.
    Block(Box<StartFailure>),
    /// The search was interrupted, see [`crate::interrupt`].
    Interrupted,
}

/// Unknowns of a start in addition to the algebraic ones.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sought<'a> {
    /// States that conditions determine, places in `y`.
    pub states: &'a [usize],
    /// The conditions, by number: as many.
    pub conditions: &'a [usize],
}

/// Point and unknowns of a start.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub catalogue: &'a Catalogue,
    pub sources: Option<&'a SourceMap>,
    /// Time of the start.
    pub time: f64,
    /// Discrete variables that are given, by their places, where the initial values of others
    /// follow the unknowns.
    pub discretes: Option<&'a [(usize, f64)]>,
}

/// Blocks of the algebraic equations in the order of their solution: places in `y` of the unknowns
/// of each.
pub(crate) struct Structure {
    pub blocks: Vec<Vec<usize>>,
}

/// Finds the blocks of the algebraic equations.
pub(crate) fn structure(system: &mut CompiledSystem, context: Context<'_>, y: &[f64]) -> Structure {
    let mut problem = Problem::new(system, context, Sought::default(), y);
    let blocks = blocks::of(&problem.incidence(), problem.len()).unwrap_or_default();
    Structure { blocks: blocks.into_iter().map(|block| block.unknowns.iter().map(|&u| problem.places[u]).collect()).collect() }
}

/// Solves for the unknowns of a start from the guesses in `y`.
pub(crate) fn solve(system: &mut CompiledSystem, context: Context<'_>, sought: Sought<'_>, y: &mut [f64]) -> Result<(), StartError> {
    let guess = y.to_vec();
    let mut problem = Problem::new(system, context, sought, y);
    let blocks = match blocks::of(&problem.incidence(), problem.len()) {
        Ok(blocks) => blocks,
        // Numbers decide: one block of everything.
        Err(_) => vec![Block { rows: (0..problem.len()).collect(), unknowns: (0..problem.len()).collect() }],
    };
    let mut pace = Pace::default();
    let whole = Block { rows: (0..problem.len()).collect(), unknowns: (0..problem.len()).collect() };
    // Blocks do not know what acts through other instants: all equations, by differences.
    problem.by_differences = problem.acts_through_instants();
    let through_instants = problem.by_differences;
    if Search::new(&mut problem, &whole, &mut pace).guessed(y) {
        problem.evaluate(y);
        return Ok(());
    }
    y.copy_from_slice(&guess);
    problem.by_differences = false;
    for (number, block) in blocks.iter().enumerate() {
        let end = Search::new(&mut problem, block, &mut pace).run(y);
        if !matches!(end, SearchEnd::Failed(_)) || !through_instants {
            finish(&mut problem, block, (number + 1, blocks.len()), (&guess, y), end)?;
        }
    }
    if through_instants {
        problem.by_differences = true;
        let end = Search::new(&mut problem, &whole, &mut pace).run(y);
        finish(&mut problem, &whole, (1, 1), (&guess, y), end)?;
        problem.evaluate(y);
    }
    Ok(())
}

/// The end of the search for a block, by its number, from the guess to the point where it ended.
fn finish(
    problem: &mut Problem<'_>,
    block: &Block,
    number: (usize, usize),
    points: (&[f64], &[f64]),
    end: SearchEnd,
) -> Result<(), StartError> {
    match end {
        SearchEnd::Solved => Ok(()),
        SearchEnd::Interrupted => Err(StartError::Interrupted),
        SearchEnd::Failed(trail) => Err(StartError::Block(Box::new(report::failure(problem, block, number, points, trail)))),
    }
}
