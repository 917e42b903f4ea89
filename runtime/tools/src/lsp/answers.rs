//! Answers to requests.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use lsp_server::{ErrorCode, RequestId, Response};
use lsp_types::{
    CodeAction, CodeActionKind, CodeActionParams, CompletionItem, CompletionParams, CompletionTextEdit, DocumentSymbol, Documentation,
    FoldingRange, FoldingRangeKind, GotoDefinitionParams, HoverContents, InlayHint, InlayHintKind, InlayHintLabel, InsertTextFormat,
    Location, MarkupContent, MarkupKind, ParameterInformation, ParameterLabel, PrepareRenameResponse, RenameParams, SelectionRange,
    SignatureHelp, SignatureInformation, TextDocumentPositionParams, TextEdit, Uri, WorkspaceEdit, WorkspaceSymbolParams,
};
use serde_json::{Value, json};
use smpl_analysis::complete::{Completion, Proposal, ProposalKind, complete};
use smpl_analysis::outline::{Entry, colours, folds, links, outline, selections};
use smpl_analysis::position::Lines;
use smpl_analysis::rename::{Edit, references, rename};
use smpl_analysis::symbols::SymbolId;
use smpl_analysis::texts::{Texts, model_of_scenario};
use smpl_analysis::{actions, equations, hints, hover, scenario, signature};
use smpl_compiler::elaborate::notes::Observer;
use smpl_dsl::format::format;

use super::convert::{Places, path_of, proposal_kind, symbol_kind, token, uri_of};
use super::edits::between;
use super::session::{Answer, At, Refused, Session, answer, is_scenario};

/// Most entries of a list of workspace symbols.
const MOST_SYMBOLS: usize = 500;

fn markdown(value: String) -> MarkupContent {
    MarkupContent { kind: MarkupKind::Markdown, value }
}

/// A scenario with its model.
struct Scenario {
    at: At,
    text: std::sync::Arc<str>,
    lines: Lines,
}

impl Scenario {
    fn places(&self) -> Places<'_> {
        Places { text: &self.text, lines: &self.lines, encoding: self.at.encoding }
    }
}

impl Session {
    fn scenario(&mut self, uri: &Uri) -> Result<Scenario, Refused> {
        let path = path_of(uri);
        let model = model_of_scenario(&path).and_then(|model| uri_of(&model));
        let model = model.ok_or_else(|| (ErrorCode::InvalidParams, "the file is not the scenario of a model".to_owned()))?;
        let text = self.texts().text(&path).ok_or_else(|| (ErrorCode::InvalidParams, "the file cannot be read".to_owned()))?;
        let at = self.at(&model)?;
        Ok(Scenario { at, lines: Lines::new(&text), text })
    }

    pub(super) fn hover(&mut self, params: lsp_types::HoverParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position_params;
        if is_scenario(&path_of(&text_document.uri)) {
            let scenario = self.scenario(&text_document.uri)?;
            let places = scenario.places();
            let found = scenario::hover(&scenario.at.program, scenario.at.facts(), &scenario.text, places.offset(position));
            return answer(found.map(|hover| shown(hover, places)));
        }
        let at = self.at(&text_document.uri)?;
        let places = at.places();
        let found = hover::hover(&at.program, at.facts(), at.file, places.offset(position));
        answer(found.map(|hover| shown(hover, places)))
    }

    pub(super) fn completion(&mut self, params: CompletionParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position;
        if is_scenario(&path_of(&text_document.uri)) {
            let scenario = self.scenario(&text_document.uri)?;
            let places = scenario.places();
            let found = scenario::complete(&scenario.at.program, scenario.at.facts(), &scenario.text, places.offset(position));
            return answer(items(&found, places));
        }
        let at = self.at(&text_document.uri)?;
        let places = at.places();
        let found = complete(&at.program, at.facts(), self.texts().as_ref(), at.file, places.offset(position));
        answer(items(&found, places))
    }

    pub(super) fn signature(&mut self, params: lsp_types::SignatureHelpParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position_params;
        let at = self.at(&text_document.uri)?;
        let found = signature::signature(&at.program, at.file, at.places().offset(position));
        answer(found.map(|found| {
            let parameters = found
                .arguments
                .iter()
                .map(|argument| ParameterInformation { label: ParameterLabel::Simple(argument.clone()), documentation: None });
            let signature = SignatureInformation {
                label: found.label,
                documentation: Some(Documentation::MarkupContent(markdown(found.text))),
                parameters: Some(parameters.collect()),
                active_parameter: Some(found.active as u32),
            };
            SignatureHelp { signatures: vec![signature], active_signature: Some(0), active_parameter: Some(found.active as u32) }
        }))
    }

    /// The symbol at a place of a model or a scenario, with its bytes.
    fn symbol(&mut self, uri: &Uri, position: lsp_types::Position) -> Result<Option<(At, SymbolId, lsp_types::Range)>, Refused> {
        if is_scenario(&path_of(uri)) {
            let scenario = self.scenario(uri)?;
            let places = scenario.places();
            let found = scenario::symbol_at(&scenario.at.program, &scenario.text, places.offset(position));
            let found = found.map(|(range, id)| (id, places.range(&range)));
            return Ok(found.map(|(id, range)| (scenario.at, id, range)));
        }
        let at = self.at(uri)?;
        let found = at.program.occurrence_at(at.file, at.places().offset(position)).copied();
        Ok(found.map(|o| {
            let range = at.places().range(&(o.span.start as usize..o.span.end as usize));
            (at, o.symbol, range)
        }))
    }

    pub(super) fn definition(&mut self, params: GotoDefinitionParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position_params;
        if let Some((at, id, _)) = self.symbol(&text_document.uri, position)? {
            let sites = at.program.symbol(id).sites.iter();
            let places = sites.filter_map(|site| {
                let file = at.program.file(site.name.file)?;
                at.places_of(site.name.file).location(&file.path, &(site.name.start as usize..site.name.end as usize))
            });
            return answer(places.collect::<Vec<Location>>());
        }
        if is_scenario(&path_of(&text_document.uri)) {
            return answer(Value::Null);
        }
        // The path of `use "path"`.
        let at = self.at(&text_document.uri)?;
        let offset = at.places().offset(position);
        let target = links(&at.program, self.texts().as_ref()).into_iter().find(|(range, _)| at.file.0 == 0 && range.contains(&offset));
        answer(target.and_then(|(_, path)| Some(Location { uri: uri_of(&path)?, range: lsp_types::Range::default() })))
    }

    /// Places of other files, in their present text.
    fn locations(&self, places: Vec<(PathBuf, Range<usize>)>) -> Vec<Location> {
        let texts = self.texts();
        let mut known: HashMap<PathBuf, Option<(std::sync::Arc<str>, Lines)>> = HashMap::new();
        let mut out = Vec::new();
        for (path, range) in places {
            let entry = known.entry(path.clone()).or_insert_with(|| texts.text(&path).map(|text| (text.clone(), Lines::new(&text))));
            let Some((text, lines)) = entry else { continue };
            out.extend(Places { text, lines, encoding: self.encoding }.location(&path, &range));
        }
        out
    }

    pub(super) fn references(&mut self, params: lsp_types::ReferenceParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position;
        let Some((at, id, _)) = self.symbol(&text_document.uri, position)? else { return answer(Value::Null) };
        let mut places = references(&at.program, id, self.texts().as_ref());
        if !params.context.include_declaration {
            let sites: Vec<(PathBuf, usize)> = at
                .program
                .symbol(id)
                .sites
                .iter()
                .filter_map(|site| Some((at.program.file(site.name.file)?.path.clone(), site.name.start as usize)))
                .collect();
            places.retain(|(path, range)| !sites.contains(&(path.clone(), range.start)));
        }
        answer(self.locations(places))
    }

    pub(super) fn highlights(&mut self, params: lsp_types::DocumentHighlightParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position_params;
        if is_scenario(&path_of(&text_document.uri)) {
            return answer(Value::Null);
        }
        let Some((at, id, _)) = self.symbol(&text_document.uri, position)? else { return answer(Value::Null) };
        let here = at.program.occurrences_of(id).filter(|o| o.span.file == at.file);
        let list = here.map(|o| {
            let range = at.places().range(&(o.span.start as usize..o.span.end as usize));
            json!({ "range": range, "kind": if o.declares { 3 } else { 2 } })
        });
        answer(list.collect::<Vec<Value>>())
    }

    pub(super) fn prepare_rename(&mut self, params: TextDocumentPositionParams) -> Answer {
        let found = self.symbol(&params.text_document.uri, params.position)?;
        let Some((at, id, range)) = found else {
            return Err((ErrorCode::InvalidRequest, "there is no declared name here".into()));
        };
        let placeholder = at.program.symbol(id).name.clone();
        answer(PrepareRenameResponse::RangeWithPlaceholder { range, placeholder })
    }

    pub(super) fn rename(&mut self, params: RenameParams) -> Answer {
        let TextDocumentPositionParams { text_document, position } = params.text_document_position;
        let Some((at, id, _)) = self.symbol(&text_document.uri, position)? else {
            return Err((ErrorCode::InvalidRequest, "there is no declared name here".into()));
        };
        let edits = rename(&at.program, id, &params.new_name, self.texts().as_ref());
        let edits = edits.map_err(|reason| (ErrorCode::RequestFailed, reason))?;
        answer(self.workspace_edit(&edits))
    }

    #[allow(clippy::mutable_key_type, reason = "the protocol's type; addresses do not change")]
    fn workspace_edit(&self, edits: &[Edit]) -> WorkspaceEdit {
        workspace_edit(edits, self.texts().as_ref(), self.encoding)
    }

    pub(super) fn outline(&mut self, params: lsp_types::DocumentSymbolParams) -> Answer {
        if is_scenario(&path_of(&params.text_document.uri)) {
            return answer(Value::Null);
        }
        let at = self.at(&params.text_document.uri)?;
        let entries = outline(&at.program, at.file);
        answer(entries.iter().map(|entry| document_symbol(entry, at.places())).collect::<Vec<_>>())
    }

    pub(super) fn workspace_symbols(&mut self, params: WorkspaceSymbolParams) -> Answer {
        let query = params.query.to_lowercase();
        let texts = self.texts();
        let mut out: Vec<Value> = Vec::new();
        for model in texts.models(Path::new("")) {
            let Some(program) = self.program_once(&model) else { continue };
            let declared = program.symbols().iter().filter(|(_, symbol)| !symbol.kind.is_local());
            for (id, symbol) in declared.filter(|(_, symbol)| symbol.name.to_lowercase().contains(&query)) {
                let Some(site) = symbol.sites.first().filter(|site| site.name.file.0 == 0) else { continue };
                let file = &program.files[0];
                let places = Places { text: &file.text, lines: &file.lines, encoding: self.encoding };
                let location = places.location(&model, &(site.name.start as usize..site.name.end as usize));
                let path = program.symbols().path(id);
                out.push(json!({ "name": path, "kind": symbol_kind(symbol.kind), "location": location }));
            }
            if out.len() >= MOST_SYMBOLS {
                break;
            }
        }
        out.truncate(MOST_SYMBOLS);
        answer(out)
    }

    /// A program that is not kept.
    fn program_once(&self, model: &Path) -> Option<smpl_analysis::program::Program> {
        smpl_analysis::program::Program::new(model, self.texts().as_ref())
    }

    pub(super) fn folds(&mut self, params: lsp_types::FoldingRangeParams) -> Answer {
        if is_scenario(&path_of(&params.text_document.uri)) {
            return answer(Value::Null);
        }
        let at = self.at(&params.text_document.uri)?;
        let comment = |line: usize| at.places().text[at.places().lines.start(line)..].trim_start().starts_with('#');
        let list = folds(&at.program, at.file).into_iter().map(|range| FoldingRange {
            start_line: range.start as u32,
            end_line: range.end as u32,
            kind: comment(range.start).then_some(FoldingRangeKind::Comment),
            ..FoldingRange::default()
        });
        answer(list.collect::<Vec<_>>())
    }

    pub(super) fn selections(&mut self, params: lsp_types::SelectionRangeParams) -> Answer {
        let at = self.at(&params.text_document.uri)?;
        let places = at.places();
        let of = |position: lsp_types::Position| {
            let ranges = selections(&at.program, at.file, places.offset(position));
            let chain = ranges.iter().rev().fold(None, |parent: Option<Box<SelectionRange>>, range| {
                Some(Box::new(SelectionRange { range: places.range(range), parent }))
            });
            chain.map_or(SelectionRange { range: lsp_types::Range { start: position, end: position }, parent: None }, |chain| *chain)
        };
        answer(params.positions.into_iter().map(of).collect::<Vec<_>>())
    }

    pub(super) fn links(&mut self, params: lsp_types::DocumentLinkParams) -> Answer {
        if is_scenario(&path_of(&params.text_document.uri)) {
            return answer(Value::Null);
        }
        let at = self.at(&params.text_document.uri)?;
        if at.file.0 != 0 {
            return answer(Value::Null);
        }
        let list = links(&at.program, self.texts().as_ref());
        let list = list.into_iter().map(|(range, path)| json!({ "range": at.places().range(&range), "target": uri_of(&path) }));
        answer(list.collect::<Vec<_>>())
    }

    pub(super) fn tokens(&mut self, params: lsp_types::SemanticTokensParams) -> Answer {
        self.tokens_of(&params.text_document.uri, None)
    }

    pub(super) fn tokens_in_range(&mut self, params: lsp_types::SemanticTokensRangeParams) -> Answer {
        self.tokens_of(&params.text_document.uri, Some(params.range))
    }

    fn tokens_of(&mut self, uri: &Uri, within: Option<lsp_types::Range>) -> Answer {
        if is_scenario(&path_of(uri)) {
            return answer(Value::Null);
        }
        let at = self.at(uri)?;
        let places = at.places();
        let within = within.map_or(0..places.text.len(), |range| places.bytes(range));
        let mut data: Vec<u32> = Vec::new();
        let mut last = lsp_types::Position::default();
        for coloured in colours(&at.program, at.file) {
            if coloured.range.end <= within.start || coloured.range.start >= within.end {
                continue;
            }
            let range = places.range(&coloured.range);
            if range.start.line != range.end.line {
                continue;
            }
            let (kind, modifiers) = token(coloured.colour);
            let line = range.start.line - last.line;
            let character = if line == 0 { range.start.character - last.character } else { range.start.character };
            data.extend([line, character, range.end.character - range.start.character, kind, modifiers | u32::from(coloured.declares)]);
            last = range.start;
        }
        answer(json!({ "data": data }))
    }

    pub(super) fn hints(&mut self, params: lsp_types::InlayHintParams) -> Answer {
        if is_scenario(&path_of(&params.text_document.uri)) {
            return answer(Value::Null);
        }
        let at = self.at(&params.text_document.uri)?;
        let places = at.places();
        let within = places.bytes(params.range);
        let shown = hints::hints(&at.program, at.facts(), at.file)
            .into_iter()
            .filter(|hint| within.start <= hint.offset && hint.offset <= within.end && self.settings.shows(hint.kind));
        let list = shown.map(|hint| InlayHint {
            position: places.position(hint.offset),
            label: InlayHintLabel::String(hint.label),
            kind: Some(if hint.kind == hints::HintKind::Unit { InlayHintKind::TYPE } else { InlayHintKind::PARAMETER }),
            text_edits: None,
            tooltip: None,
            padding_left: None,
            padding_right: None,
            data: None,
        });
        answer(list.collect::<Vec<_>>())
    }

    pub(super) fn format(&mut self, params: lsp_types::DocumentFormattingParams) -> Answer {
        self.formatted(&params.text_document.uri, None)
    }

    pub(super) fn format_range(&mut self, params: lsp_types::DocumentRangeFormattingParams) -> Answer {
        self.formatted(&params.text_document.uri, Some(params.range))
    }

    fn formatted(&mut self, uri: &Uri, within: Option<lsp_types::Range>) -> Answer {
        let path = path_of(uri);
        let Some(text) = self.texts().text(&path).filter(|_| !is_scenario(&path)) else { return answer(Value::Null) };
        let Ok(new) = format(&text) else { return answer(Value::Null) };
        let lines = Lines::new(&text);
        let places = Places { text: &text, lines: &lines, encoding: self.encoding };
        let within = within.map_or(0..text.len(), |range| places.bytes(range));
        let edits = between(&text, &new).into_iter().filter(|(range, _)| range.start <= within.end && within.start <= range.end);
        answer(edits.map(|(range, new_text)| TextEdit { range: places.range(&range), new_text }).collect::<Vec<_>>())
    }

    /// Tries edits on a separate thread, since each is compiled.
    pub(super) fn code_actions(&mut self, id: RequestId, params: CodeActionParams) -> Answer {
        if is_scenario(&path_of(&params.text_document.uri)) {
            return answer(Value::Null);
        }
        let at = self.at(&params.text_document.uri)?;
        let Some(outcome) = at.outcome.clone() else { return answer(Value::Null) };
        let places = at.places();
        let asked = places.bytes(params.range);
        let here = |d: &&smpl_dsl::diagnostic::Diagnostic| {
            d.primary.span.file == at.file && d.primary.span.start as usize <= asked.end && asked.start <= d.primary.span.end as usize
        };
        let found: Vec<_> = outcome.checked.diagnostics.iter().filter(here).cloned().collect();
        if found.is_empty() || !std::sync::Arc::ptr_eq(&outcome.program, &at.program) {
            return answer(Value::Null);
        }
        let (texts, encoding) = (self.texts(), self.encoding);
        let shared = std::sync::Arc::clone(&self.worker.shared);
        let given = params.context.diagnostics;
        let work = move || {
            let mut list = Vec::new();
            for d in &found {
                let fixes = actions::fixes(&outcome.program, &outcome.checked.diagnostics, d, texts.as_ref(), &Observer::default());
                let own = given.iter().find(|known| known.message.starts_with(&d.message)).cloned();
                list.extend(fixes.into_iter().enumerate().map(|(i, fix)| CodeAction {
                    title: fix.title,
                    kind: Some(CodeActionKind::QUICKFIX),
                    diagnostics: own.clone().map(|own| vec![own]),
                    edit: Some(workspace_edit(std::slice::from_ref(&fix.edit), texts.as_ref(), encoding)),
                    is_preferred: Some(i == 0),
                    ..CodeAction::default()
                }));
            }
            list
        };
        std::thread::spawn(move || {
            let response = match std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)) {
                Ok(list) => Response::new_ok(id, list),
                Err(_) => Response::new_err(id, ErrorCode::InternalError as i32, "internal error in `textDocument/codeAction`".into()),
            };
            shared.send(response);
        });
        Ok(None)
    }

    pub(super) fn pull(&mut self, id: RequestId, params: lsp_types::DocumentDiagnosticParams) -> Answer {
        let path = path_of(&params.text_document.uri);
        let root = self.root_of(&path);
        self.shared().pull(id, &path, &root);
        Ok(None)
    }

    /// Typeset equations of a file and its imports, with their places: for pages that show them.
    pub(super) fn equations(&mut self, params: lsp_types::DocumentSymbolParams) -> Answer {
        let at = self.at(&params.text_document.uri)?;
        let list = equations::equations(&at.program).into_iter().filter_map(|equation| {
            let file = at.program.file(equation.span.file)?;
            let range = equation.span.start as usize..equation.span.end as usize;
            let location = at.places_of(equation.span.file).location(&file.path, &range)?;
            Some(json!({
                "latex": equation.latex, "location": location, "within": equation.within, "definition": equation.definition,
            }))
        });
        answer(list.collect::<Vec<_>>())
    }
}

fn shown(found: hover::Hover, places: Places<'_>) -> lsp_types::Hover {
    let range = Some(places.range(&found.range));
    lsp_types::Hover { contents: HoverContents::Markup(markdown(found.markdown)), range }
}

fn items(found: &Completion, places: Places<'_>) -> Value {
    let range = places.range(&found.replaces);
    let item = |(i, proposal): (usize, &Proposal)| CompletionItem {
        label: proposal.label.clone(),
        kind: Some(proposal_kind(proposal.kind)),
        detail: (!proposal.detail.is_empty()).then(|| proposal.detail.clone()),
        sort_text: Some(format!("{:02}{i:05}", proposal.rank)),
        insert_text_format: Some(if proposal.snippet { InsertTextFormat::SNIPPET } else { InsertTextFormat::PLAIN_TEXT }),
        text_edit: Some(CompletionTextEdit::Edit(TextEdit { range, new_text: proposal.insert.clone() })),
        filter_text: (proposal.kind == ProposalKind::Unit).then(|| proposal.label.clone()),
        ..CompletionItem::default()
    };
    json!({ "isIncomplete": false, "items": found.proposals.iter().enumerate().map(item).collect::<Vec<_>>() })
}

#[allow(deprecated, reason = "the field of the protocol's type must be given")]
fn document_symbol(entry: &Entry, places: Places<'_>) -> DocumentSymbol {
    let inside = entry.range.start <= entry.name_range.start && entry.name_range.end <= entry.range.end;
    let selection = if inside { &entry.name_range } else { &entry.range };
    DocumentSymbol {
        name: entry.name.clone(),
        detail: Some(entry.detail.clone()),
        kind: symbol_kind(entry.kind),
        tags: None,
        deprecated: None,
        range: places.range(&entry.range),
        selection_range: places.range(selection),
        children: (!entry.children.is_empty()).then(|| entry.children.iter().map(|child| document_symbol(child, places)).collect()),
    }
}

#[allow(clippy::mutable_key_type, reason = "the protocol's type; addresses do not change")]
fn workspace_edit(edits: &[Edit], texts: &dyn Texts, encoding: smpl_analysis::position::Encoding) -> WorkspaceEdit {
    let mut changes: HashMap<Uri, Vec<TextEdit>> = HashMap::new();
    for edit in edits {
        let (Some(uri), Some(text)) = (uri_of(&edit.path), texts.text(&edit.path)) else { continue };
        let lines = Lines::new(&text);
        let range = Places { text: &text, lines: &lines, encoding }.range(&edit.range());
        changes.entry(uri).or_default().push(TextEdit { range, new_text: edit.text.clone() });
    }
    WorkspaceEdit { changes: Some(changes), ..WorkspaceEdit::default() }
}
