//! The order of a function's code: items, then loops, in the loops the same again.

use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::{InstBuilder, Value, types};
use cranelift_codegen::isa::TargetIsa;
use cranelift_frontend::FunctionBuilder;

use super::emitter::{Arguments, Emitter, Input};
use super::plan::{Piece, Plan, ScheduleSlice};
use super::{memory, wide};
use crate::ir::Exprs;
use crate::layout::Layout;
use crate::schedule::{BlockId, Item};

/// Writes the code of the parts of a function; returns the numbers of working memory it uses.
pub(super) fn emit(
    mut builder: FunctionBuilder<'_>,
    plan: &Plan,
    piece: &Piece,
    exprs: &Exprs,
    layout: &Layout,
    isa: &dyn TargetIsa,
) -> u32 {
    let entry = builder.create_block();
    builder.append_block_params_for_function_params(entry);
    builder.switch_to_block(entry);
    let p = builder.block_params(entry);
    let arguments = Arguments { time: p[0], factor: p[1], y: p[2], yp: p[3], work: p[4], out: p[5], surroundings: p[6] };
    let rounding = has_rounding(isa);
    let mut columns = 0;
    let mut rest = Some(builder);
    for part in &piece.parts {
        let Some(b) = rest.take() else { break };
        let (schedule, segments) = &plan.schedules[part.schedule];
        let (lean, in_place) = (piece.lean, plan.in_place);
        let mut emitter = Emitter::new(b, Input { exprs, layout, schedule, segments, arguments, lean, in_place, rounding });
        emitter.outside(part);
        columns = columns.max(emitter.columns);
        rest = Some(emitter.b);
    }
    if let Some(mut b) = rest {
        b.ins().return_(&[]);
        b.seal_all_blocks();
        b.finalize(isa.frontend_config());
    }
    columns
}

/// Returns `true` if rounding is an instruction; elsewhere Cranelift would call a library.
fn has_rounding(isa: &dyn TargetIsa) -> bool {
    let by_flag = isa.isa_flags().iter().any(|f| f.name == "has_sse41" && f.as_bool() == Some(true));
    by_flag || !matches!(isa.triple().architecture, target_lexicon::Architecture::X86_64)
}

impl Emitter<'_> {
    /// Writes items and loops of a part of a function.
    fn outside(&mut self, part: &ScheduleSlice) {
        for i in part.items.clone() {
            let item = self.input.schedule.blocks[0].items[i];
            self.item(0, item);
            if self.input.segments.ends_at(i) {
                let result = match item {
                    Item::Eval(expr) | Item::Reduce { expr, .. } => self.values[0].remove_entry(&expr),
                    Item::Store(..) => None,
                };
                self.values[0].clear();
                self.values[0].extend(result);
            }
        }
        for &child in &part.loops {
            if self.input.segments.is_active() {
                self.values[0].clear();
                if !self.input.lean {
                    self.fetch_for_loop(child);
                }
            }
            self.inner_loop(child);
        }
    }

    /// Writes the items of a loop, then the loops in it.
    fn inside(&mut self, block: BlockId) {
        let schedule = self.input.schedule;
        schedule.blocks[block].items.iter().for_each(|item| self.item(block, *item));
        schedule.blocks[block].children.iter().for_each(|&child| self.inner_loop(child));
    }

    fn inner_loop(&mut self, block: BlockId) {
        if wide::is_in_lanes(self, block) {
            wide::wide_loop(self, block);
        } else {
            self.scalar_loop(block);
        }
    }

    /// Loads what a loop of stores needs from outside ahead of it.
    fn fetch_for_loop(&mut self, child: BlockId) {
        let mut items = vec![];
        self.input.schedule.each_item(child, &mut |block, item| items.push((block, item)));
        items.into_iter().for_each(|(block, item)| self.fetch_outside(block, item));
    }

    fn scalar_loop(&mut self, block: BlockId) {
        memory::prepare_pointers(self, block);
        let extent = i64::from(self.input.schedule.blocks[block].extent);
        self.counted(extent, &mut |emitter, counter| {
            emitter.counters[block] = Some(counter);
            emitter.inside(block);
            emitter.forget(block);
        });
    }

    /// A loop of counters below `passes`; at least one pass.
    fn counted(&mut self, passes: i64, pass: &mut dyn FnMut(&mut Self, Value)) {
        let start = self.b.ins().iconst(types::I64, 0);
        if passes <= 1 {
            pass(self, start);
            return;
        }
        let (body, exit) = (self.b.create_block(), self.b.create_block());
        let counter = self.b.append_block_param(body, types::I64);
        self.b.ins().jump(body, &[start.into()]);
        self.b.switch_to_block(body);
        pass(self, counter);
        let next = self.b.ins().iadd_imm_s(counter, 1);
        let more = self.b.ins().icmp_imm_s(IntCC::SignedLessThan, next, passes);
        self.b.ins().brif(more, body, &[next.into()], exit, &[]);
        self.b.switch_to_block(exit);
    }
}
