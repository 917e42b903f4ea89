import assert from "node:assert/strict";
import { test } from "node:test";
import { ChangeSet, Text } from "@codemirror/state";
import { contentChanges, editorChanges, editsByFile, offsetOf, positionOf, snippetText } from "../src/editor/convert.ts";
import { middle } from "../src/editor/features.ts";
import { labelParts } from "../src/editor/signature.ts";

const text = Text.of(["param T : °C = 3", "# 😀 x", "eq y = T"]);

test("positions count UTF-16 units", () => {
  const offset = text.toString().indexOf("x");
  assert.deepEqual(positionOf(text, offset), { line: 1, character: 5 });
  assert.equal(offsetOf(text, { line: 1, character: 5 }), offset);
});

test("positions outside of the text are moved into it", () => {
  assert.equal(offsetOf(text, { line: 0, character: 99 }), text.line(1).to);
  assert.equal(offsetOf(text, { line: 99, character: 0 }), text.length);
});

test("changes sent one after another give the text of the editor", () => {
  const changes = ChangeSet.of([{ from: 0, to: 5, insert: "state" }, { from: 8, insert: "\n\n" }, { from: 20, to: 24 }], text.length);
  let sent = text;
  for (const change of contentChanges(text, changes)) {
    sent = sent.replace(offsetOf(sent, change.range.start), offsetOf(sent, change.range.end), Text.of(change.text.split("\n")));
  }
  assert.equal(sent.toString(), changes.apply(text).toString());
});

test("edits of the server become changes of the editor", () => {
  const edits = [{ range: { start: { line: 2, character: 3 }, end: { line: 2, character: 4 } }, newText: "z" }];
  assert.deepEqual(editorChanges(text, edits), [{ from: text.line(3).from + 3, to: text.line(3).from + 4, insert: "z" }]);
});

test("edits of all files are found in both forms", () => {
  const edit = { range: { start: { line: 0, character: 0 }, end: { line: 0, character: 0 } }, newText: "a" };
  const files = editsByFile({ changes: { a: [edit] }, documentChanges: [{ textDocument: { uri: "b" }, edits: [edit, edit] }] });
  assert.deepEqual([...files].map(([uri, edits]) => [uri, edits.length]), [["a", 1], ["b", 2]]);
});

test("snippets keep their fields", () => {
  assert.equal(snippetText("param ${1:name} : ${2:unit} = $3$0"), "param #{1:name} : #{2:unit} = #{3}#{}");
});

test("a formatted text replaces only what differs", () => {
  assert.deepEqual(middle("a  =  b\nc", "a = b\nc"), { from: 2, to: 5, insert: "=" });
  assert.deepEqual(middle("same", "same"), { from: 4, to: 4, insert: "" });
  const [before, after] = ["aaa", "aa"];
  const m = middle(before, after);
  assert.equal(before.slice(0, m.from) + m.insert + before.slice(m.to), after);
});

test("the active argument is found where a name occurs in another", () => {
  assert.deepEqual(labelParts("clip(x, xmax, x)", ["x", "xmax", "x"], 1), ["clip(x, ", "xmax", ", x)"]);
  assert.deepEqual(labelParts("clip(x, xmax, x)", ["x", "xmax", "x"], 2), ["clip(x, xmax, ", "x", ")"]);
  assert.deepEqual(labelParts("f()", [], 0), ["f()", "", ""]);
});
