//! Machine code by Cranelift: one function a staged program, position-independent, without
//! relocations.
//!
//! [`schedule`](crate::schedule) decides what is computed in which loop, and `body` walks the
//! schedule and emits scalar code and loops. `wide` emits innermost loops two lanes at a time, with
//! elementary functions taken out into array kernels over columns of working memory. Loops stay
//! loops: the size of the code does not depend on extents.

mod arithmetic;
mod body;
mod emitter;
mod executable;
mod loops;
mod memory;
mod phases;
mod plan;
mod residence;
mod segments;
mod wide;
mod workers;

use std::sync::OnceLock;

use cranelift_codegen::ir::{AbiParam, Function, Signature, UserFuncName, types};
use cranelift_codegen::isa::{CallConv, OwnedTargetIsa};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_codegen::{Context, control::ControlPlane};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub(crate) use executable::Executable;
pub(crate) use plan::{Piece, Plan};
pub(crate) use workers::{Generated, Request, generate};

use crate::ir::Exprs;
use crate::kernels::KernelTable;
use crate::layout::Layout;
use crate::schedule::{Access, ScheduleError, Staged, schedules};

/// Functions and data of compiled code in addition to its arguments.
#[derive(Clone, Copy)]
#[repr(C)]
pub(crate) struct Surroundings {
    /// Elementary functions.
    pub kernels: KernelTable,
    /// Position tables.
    pub tables: *const u32,
    /// The lists that numbers are looked up in.
    pub lists: *const f64,
}

/// A compiled function: time, factor of derivatives, unknowns, their derivatives, workspace,
/// output, surroundings.
pub(crate) type CompiledFn = unsafe extern "C" fn(f64, f64, *mut f64, *const f64, *mut f64, *mut f64, *const Surroundings);

/// Failures of code generation.
#[derive(Debug, Error)]
pub enum GenerateError {
    /// A fault of the passes before.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// Cranelift does not know this processor.
    #[error("no code generator for this processor: {0}")]
    Processor(String),
    /// Cranelift refused a function.
    #[error("code generation of `{function}` failed: {message}")]
    Refused {
        /// The function.
        function: &'static str,
        /// Its words.
        message: String,
    },
    /// The code would hold addresses.
    #[error("code of `{function}` holds {count} relocations")]
    Relocations {
        /// The function.
        function: &'static str,
        /// Count.
        count: usize,
    },
}

/// Effort of code generation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Effort {
    /// For functions of the inner loop of the solver: optimised.
    Hot,
    /// As hot, for long code whose values are spread over registers and memory before Cranelift
    /// sees them: there is nothing to move, and equal values are one already.
    Lean,
    /// For functions of a step: quickly compiled.
    Lukewarm,
    /// For functions that the solver calls once in an internal step: hot, but quickly compiled
    /// where they are cut into pieces.
    Warm,
}

impl Effort {
    /// The effort for a piece of a function.
    fn of(self, plan: &Plan, piece: &Piece) -> Effort {
        match self {
            Effort::Warm if plan.pieces().len() > 1 => Effort::Lukewarm,
            Effort::Hot | Effort::Warm if piece.lean => Effort::Lean,
            Effort::Warm => Effort::Hot,
            other => other,
        }
    }
}

/// A piece of machine code.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Code {
    /// Position-independent instructions and constants.
    pub bytes: Vec<u8>,
    /// Numbers of working memory that the function uses.
    pub columns: u32,
    /// Intermediate text, if asked for.
    pub clif: String,
    /// Assembly, if asked for.
    pub assembly: String,
}

/// Cuts a staged program into pieces; an empty one has none.
///
/// # Errors
/// If the staged program addresses what it cannot have.
pub(crate) fn plan(staged: &Staged, exprs: &Exprs, layout: &Layout, access: Access) -> Result<Plan, GenerateError> {
    let schedules = if staged.is_empty() { vec![] } else { schedules(staged, exprs, layout, access)? };
    Ok(Plan::new(schedules, exprs, staged.in_place))
}

/// Generates functions; keeps Cranelift's buffers between them.
pub(crate) struct Generator {
    context: Context,
    builder: FunctionBuilderContext,
    control: ControlPlane,
    /// Texts of the code are wanted.
    texts: bool,
}

impl Generator {
    /// A generator; with `texts` it also writes intermediate text and assembly.
    #[must_use]
    pub(crate) fn new(texts: bool) -> Generator {
        Generator { context: Context::new(), builder: FunctionBuilderContext::new(), control: ControlPlane::default(), texts }
    }

    /// Compiles a piece of a staged program.
    ///
    /// # Errors
    /// If Cranelift refuses.
    pub(crate) fn compile(
        &mut self,
        plan: &Plan,
        piece: &Piece,
        exprs: &Exprs,
        layout: &Layout,
        function: &'static str,
        effort: Effort,
    ) -> Result<Code, GenerateError> {
        let isa = isa(effort.of(plan, piece))?;
        self.context.clear();
        self.context.set_disasm(self.texts);
        self.context.func = Function::with_name_signature(UserFuncName::default(), signature(isa.default_call_conv()));
        let builder = FunctionBuilder::new(&mut self.context.func, &mut self.builder);
        let columns = loops::emit(builder, plan, piece, exprs, layout, isa.as_ref());
        let mut code = Code { columns, ..Code::default() };
        if self.texts {
            code.clif = self.context.func.display().to_string();
        }
        self.finish(isa, function, code)
    }

    fn finish(&mut self, isa: &OwnedTargetIsa, function: &'static str, mut code: Code) -> Result<Code, GenerateError> {
        let refused = |message: String| GenerateError::Refused { function, message };
        let compiled = self.context.compile(isa.as_ref(), &mut self.control).map_err(|e| refused(format!("{:?}", e.inner)))?;
        let count = compiled.buffer.relocs().len();
        if count > 0 {
            return Err(GenerateError::Relocations { function, count });
        }
        code.bytes = compiled.code_buffer().to_vec();
        code.assembly = compiled.vcode.clone().unwrap_or_default();
        Ok(code)
    }
}

fn signature(convention: CallConv) -> Signature {
    let mut signature = Signature::new(convention);
    signature.params.extend([types::F64, types::F64].map(AbiParam::new));
    signature.params.extend([types::I64; 5].map(AbiParam::new));
    signature
}

/// Platform and processor features that generated code relies on.
///
/// # Errors
/// If Cranelift does not know this processor.
pub(crate) fn target() -> Result<String, GenerateError> {
    let isa = isa(Effort::Hot)?;
    let features = isa.isa_flags();
    let names = features.iter().filter(|f| f.as_bool() == Some(true)).map(|f| f.name);
    Ok(std::iter::once(isa.triple().to_string()).chain(names.map(str::to_owned)).collect::<Vec<_>>().join(" "))
}

/// The target of this processor at an effort, made once.
fn isa(effort: Effort) -> Result<&'static OwnedTargetIsa, GenerateError> {
    static TARGETS: [OnceLock<Result<OwnedTargetIsa, String>>; 4] = [const { OnceLock::new() }; 4];
    let target = TARGETS[effort as usize].get_or_init(|| make_isa(effort));
    target.as_ref().map_err(|message| GenerateError::Processor(message.clone()))
}

fn make_isa(effort: Effort) -> Result<OwnedTargetIsa, String> {
    let mut flags = settings::builder();
    let options = match effort {
        Effort::Hot | Effort::Warm => [("opt_level", "speed"), ("regalloc_algorithm", "backtracking")],
        Effort::Lean => [("opt_level", "none"), ("regalloc_algorithm", "backtracking")],
        Effort::Lukewarm => [("opt_level", "none"), ("regalloc_algorithm", "single_pass")],
    };
    let verify = if cfg!(any(test, debug_assertions)) { "true" } else { "false" };
    // Loads that could be shared are shared already; nothing unwinds through compiled code.
    let common = [("enable_verifier", verify), ("is_pic", "true"), ("enable_alias_analysis", "false"), ("unwind_info", "false")];
    for (name, value) in options.into_iter().chain(common) {
        flags.set(name, value).map_err(|e| e.to_string())?;
    }
    let builder = cranelift_native::builder()?;
    builder.finish(settings::Flags::new(flags)).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests;
