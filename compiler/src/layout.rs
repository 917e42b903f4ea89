//! Memory of every variable: one workspace per instance, the unknowns outside of it.
//!
//! The workspace is one buffer of numbers. Regions hold the variables of one role each, in the
//! order of their ids. The frames `Initial`, `Previous` and `Steady` are copies of four regions
//! (`y`, actions, discrete variables, disturbances) at other instants. Caches and working memory of
//! the compiled functions come last.

use std::ops::Range;

use cranelift_entity::SecondaryMap;
use serde::{Deserialize, Serialize};

use crate::ir::{BUILTIN_COUNT, Builtin, Flavour, Role, VarId};
use crate::model::Model;

mod memory;

pub use memory::Memory;

/// Numbers in a cache line: regions start there.
const LINE: u32 = 8;

/// A part of the workspace as seen from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Region {
    /// Elements by [`Builtin`].
    Builtin,
    /// Parameters.
    Param,
    /// 1 where a parameter was given.
    ParamGiven,
    /// Actions.
    Action,
    /// Discrete variables.
    Discrete,
    /// Disturbances.
    Disturbance,
    /// Standard variates.
    Draw,
    /// Quadratures over the current step.
    Quadrature,
    /// Delayed values.
    Delayed,
    /// Copy at the start of the episode.
    Initial(FramePart),
    /// Copy at the end of the step before.
    Previous(FramePart),
    /// Copy at the steady state.
    Steady(FramePart),
}

/// A part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FramePart {
    /// All unknowns.
    Y,
    /// Actions.
    Action,
    /// Discrete variables.
    Discrete,
    /// Disturbances.
    Disturbance,
}

const SIMPLE: [Role; 9] = [
    Role::Builtin,
    Role::Param,
    Role::ParamGiven,
    Role::Action,
    Role::Discrete,
    Role::Disturbance,
    Role::Draw,
    Role::Quadrature,
    Role::Delayed,
];
const PARTS: usize = 4;
const REGIONS: usize = SIMPLE.len() + 3 * PARTS;

impl Region {
    fn index(self) -> usize {
        let frame = |number: usize, part: FramePart| SIMPLE.len() + number * PARTS + part as usize;
        match self {
            Region::Builtin => 0,
            Region::Param => 1,
            Region::ParamGiven => 2,
            Region::Action => 3,
            Region::Discrete => 4,
            Region::Disturbance => 5,
            Region::Draw => 6,
            Region::Quadrature => 7,
            Region::Delayed => 8,
            Region::Initial(part) => frame(0, part),
            Region::Previous(part) => frame(1, part),
            Region::Steady(part) => frame(2, part),
        }
    }
}

/// Base of an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Base {
    /// The unknowns.
    Y,
    /// Their derivatives.
    Yp,
    /// The workspace.
    Work,
    /// The output of the function.
    Out,
    /// The scalar argument of the Jacobian.
    Factor,
}

/// Place of the first element of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Address {
    /// Memory.
    pub base: Base,
    /// Numbers before it.
    pub offset: u32,
}

/// Places of all variables and regions.
#[derive(Clone, Debug)]
pub struct Layout {
    regions: [(u32, u32); REGIONS],
    /// Offset inside the region of the role, or in `y`.
    offsets: SecondaryMap<VarId, Option<u32>>,
    roles: SecondaryMap<VarId, Option<(Role, u32)>>,
    caches: u32,
    scratch: u32,
    columns: u32,
    len: u32,
    unknowns: u32,
    states: u32,
}

impl Layout {
    /// Places the variables of a model; `columns` numbers of working memory for compiled functions
    /// come on top.
    #[must_use]
    pub fn new(model: &Model, columns: u32) -> Layout {
        let mut layout = Layout::empty();
        let mut unknowns = 0;
        for &var in &model.unknowns {
            let variable = &model.vars[var];
            layout.offsets[var] = Some(unknowns);
            unknowns += variable.len;
            if variable.role == Role::State {
                layout.states = unknowns;
            }
        }
        layout.unknowns = unknowns;
        let mut sizes = [0; SIMPLE.len()];
        let (mut caches, mut scratch) = (0, 0);
        for (var, variable) in model.vars.iter() {
            layout.roles[var] = Some((variable.role, variable.len));
            let size = match variable.role {
                Role::State | Role::Algebraic => continue,
                Role::Cache => &mut caches,
                Role::Scratch => &mut scratch,
                role => match SIMPLE.iter().position(|&r| r == role) {
                    Some(i) => &mut sizes[i],
                    None => continue,
                },
            };
            layout.offsets[var] = Some(*size);
            *size += variable.len;
        }
        sizes[0] = sizes[0].max(BUILTIN_COUNT);
        // A model may declare only some of its parameters' flags; the region mirrors the
        // parameters.
        sizes[2] = sizes[2].max(sizes[1]);
        layout.place(sizes, caches, scratch, columns);
        layout
    }

    fn empty() -> Layout {
        Layout {
            regions: [(0, 0); REGIONS],
            offsets: SecondaryMap::new(),
            roles: SecondaryMap::new(),
            caches: 0,
            scratch: 0,
            columns: 0,
            len: 0,
            unknowns: 0,
            states: 0,
        }
    }

    fn place(&mut self, sizes: [u32; SIMPLE.len()], caches: u32, scratch: u32, columns: u32) {
        let mut next = 0;
        let mut reserve = |size: u32| {
            let start = next;
            next += size.next_multiple_of(LINE);
            start
        };
        for (i, size) in sizes.into_iter().enumerate() {
            self.regions[i] = (reserve(size), size);
        }
        let frame = [self.unknowns, sizes[3], sizes[4], sizes[5]];
        for (i, size) in (SIMPLE.len()..REGIONS).zip(frame.into_iter().cycle()) {
            self.regions[i] = (reserve(size), size);
        }
        self.caches = reserve(caches);
        self.scratch = reserve(scratch);
        self.columns = reserve(columns);
        self.len = next;
    }

    /// Numbers in the workspace.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len as usize
    }

    /// Returns `true` if the workspace is empty (it never is: the builtins are always there).
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Length of `y`.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.unknowns as usize
    }

    /// Leading part of `y` that is differential.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states as usize
    }

    /// First number of the working memory of compiled functions.
    #[must_use]
    pub fn columns(&self) -> u32 {
        self.columns
    }

    /// Place of a region in the workspace.
    #[must_use]
    #[inline]
    pub fn range(&self, region: Region) -> Range<usize> {
        let (start, len) = self.regions[region.index()];
        start as usize..(start + len) as usize
    }

    /// Offset of a variable inside its region, of an unknown in `y`; `None` for a variable without
    /// memory.
    #[must_use]
    pub fn offset(&self, var: VarId) -> Option<usize> {
        self.offsets[var].map(|o| o as usize)
    }

    /// Number of elements of a variable.
    #[must_use]
    pub fn elements(&self, var: VarId) -> u32 {
        self.roles[var].map_or(0, |(_, len)| len)
    }

    /// Place of a variable's first element; `None` where that copy does not exist.
    #[must_use]
    pub(crate) fn address(&self, var: VarId, flavour: Flavour) -> Option<Address> {
        let (role, _) = self.roles[var]?;
        let offset = self.offsets[var]?;
        let part = match role {
            Role::State | Role::Algebraic => Some(FramePart::Y),
            Role::Action => Some(FramePart::Action),
            Role::Discrete => Some(FramePart::Discrete),
            Role::Disturbance => Some(FramePart::Disturbance),
            _ => None,
        };
        let start = match (flavour, part) {
            (Flavour::Value, Some(FramePart::Y)) => {
                return Some(Address { base: Base::Y, offset });
            }
            (Flavour::Derivative, Some(FramePart::Y)) => {
                return Some(Address { base: Base::Yp, offset });
            }
            (Flavour::Derivative, _) => return None,
            (Flavour::Value, _) => match role {
                Role::Cache => self.caches,
                Role::Scratch => self.scratch,
                _ => self.regions[SIMPLE.iter().position(|&r| r == role)?].0,
            },
            (Flavour::Initial, Some(part)) => self.regions[Region::Initial(part).index()].0,
            (Flavour::Previous, Some(part)) => self.regions[Region::Previous(part).index()].0,
            (Flavour::Steady, Some(part)) => self.regions[Region::Steady(part).index()].0,
            // What does not change within an episode is its own copy at any instant.
            (_, None) => self.regions[SIMPLE.iter().position(|&r| r == role)?].0,
        };
        Some(Address { base: Base::Work, offset: start + offset })
    }

    /// Returns `true` if a load of that element of a variable is the Jacobian's scalar argument.
    #[must_use]
    pub(crate) fn is_factor(&self, var: VarId, element: i64) -> bool {
        matches!(self.roles[var], Some((Role::Builtin, _))) && element == Builtin::DerivativeFactor as i64
    }
}
