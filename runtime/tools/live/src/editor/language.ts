// Highlighting of `.eq` texts.

import { HighlightStyle, LanguageSupport, StreamLanguage, type StringStream, syntaxHighlighting } from "@codemirror/language";
import { tags } from "@lezer/highlight";

const STATEMENTS = new Set(
  ("model use time set table def param action state var let discrete disturbance random eq domain flux connector component port connect initial steady observe level reward fail " +
    "success constraint invariant episode solver policy at next reset clamp control event phase variant choice when test unit").split(" "),
);
const DECLARING = new Set("time param action state var let discrete disturbance random table flux connector port set reward observe level".split(" "));
const WORDS = new Set(
  ("if then else and or not for in as every delay noise scale clip named default when rate until over cells from linear bounds columns outside inside low high stretch faces areas " +
    "volumes scheme geometry event extends expect within").split(" "),
);
/** Words that mean something in one statement and are good names elsewhere. */
const ONLY_IN: Record<string, string> = {
  rate: "invariant", low: "flux", high: "flux", columns: "table", linear: "table", from: "table", stretch: "domain", faces: "domain", areas: "domain",
  volumes: "domain", scheme: "domain", geometry: "domain", cells: "domain",
};
const CONSTANTS = new Set(["pi", "e", "inf", "true", "false"]);

interface State {
  /** A statement may begin here. */
  fresh: boolean;
  declaring: boolean;
  /** Inside of a declaration's unit, after its colon. */
  unit: boolean;
  /** Depth of round and square brackets. */
  depth: number;
  /** Kind of the last token: a unit may follow a number or `as`. */
  last: "number" | "as" | "name" | "other";
  bracketUnit: boolean;
  /** First word of the statement. */
  statement: string;
  /** In the headings of a table, where brackets after names hold units. */
  columns: boolean;
}

function token(stream: StringStream, state: State): string | null {
  if (stream.sol() && state.depth === 0) {
    state.fresh = true;
    state.unit = false;
    state.columns = false;
  }
  if (stream.eatSpace()) return null;
  if (stream.match(/^#.*/)) {
    state.unit = false;
    return "comment";
  }
  if (stream.match(/^"[^"]*"?/)) {
    state.unit = false;
    state.last = "other";
    return "string";
  }
  if (state.bracketUnit) {
    if (stream.eat("]")) {
      state.bracketUnit = false;
      state.last = "other";
      return "bracket";
    }
    stream.match(/^[^\]\s]+/) || stream.next();
    return "unit";
  }
  if (state.unit) {
    if (stream.match(/^(in|scale|clip|default|over|named|for|when|every|delay|noise|until|from|linear)\b/)) {
      state.unit = false;
      state.fresh = false;
      return "keyword";
    }
    if (stream.match(/^[\p{L}°%\d_.]+|^[*/^()-]/u)) return "unit";
    state.unit = false;
  }
  return symbol(stream, state);
}

function symbol(stream: StringStream, state: State): string | null {
  if (stream.match(/^d\s*\/\s*dt\b/)) {
    state.fresh = false;
    state.last = "other";
    return "derivative";
  }
  if (stream.match(/^\d+(\.(?!\.)\d+)?([eE][+-]?\d+)?/)) {
    state.last = "number";
    state.fresh = false;
    return "number";
  }
  const word = stream.match(/^[\p{L}_][\p{L}\p{N}_]*/u) as RegExpMatchArray | null;
  if (word) return named(word[0], stream, state);
  const c = stream.next();
  if (c === "[" && (state.last === "number" || state.last === "as" || state.columns)) {
    state.bracketUnit = true;
    return "bracket";
  }
  if (c === "[" || c === "(") state.depth += 1;
  if (c === "]" || c === ")") state.depth = Math.max(0, state.depth - 1);
  if (c === ":" && state.declaring && state.depth === 0) state.unit = true;
  state.fresh = c === "{" || c === "}" || c === ";";
  if (c === "{") state.declaring = false;
  state.last = "other";
  return c !== null && c !== undefined && "[](){}".includes(c as string) ? "bracket" : "operator";
}

function named(word: string, stream: StringStream, state: State): string {
  const begins = state.fresh && STATEMENTS.has(word) && !stream.match(/^\s*(=(?!=)|:|,|\})/, false);
  state.fresh = false;
  state.last = word === "as" ? "as" : "name";
  if (begins) {
    state.declaring = DECLARING.has(word);
    state.statement = word;
    return "keyword";
  }
  if (word === "columns") state.columns = true;
  if (WORDS.has(word) && (ONLY_IN[word] ?? state.statement) === state.statement && !stream.match(/^\s*=(?!=)/, false)) return "word";
  if (CONSTANTS.has(word)) return "atom";
  if (stream.match(/^\(/, false)) return "function";
  return "variable";
}

const language = StreamLanguage.define<State>({
  name: "smpl",
  startState: () => ({ fresh: true, declaring: false, unit: false, depth: 0, last: "other", bracketUnit: false, columns: false, statement: "" }),
  token,
  languageData: { commentTokens: { line: "#" }, closeBrackets: { brackets: ["(", "[", "{", '"'] } },
  tokenTable: {
    word: tags.operatorKeyword,
    unit: tags.unit,
    derivative: tags.definitionKeyword,
    function: tags.function(tags.variableName),
    variable: tags.variableName,
    bracket: tags.bracket,
    operator: tags.operator,
    atom: tags.atom,
  },
});

const colours = HighlightStyle.define([
  { tag: tags.keyword, color: "var(--code-keyword)", fontWeight: "600" },
  { tag: tags.operatorKeyword, color: "var(--code-keyword)" },
  { tag: tags.definitionKeyword, color: "var(--code-keyword)" },
  { tag: tags.unit, color: "var(--code-unit)" },
  { tag: tags.number, color: "var(--code-number)" },
  { tag: tags.atom, color: "var(--code-number)" },
  { tag: tags.string, color: "var(--code-text)" },
  { tag: tags.comment, color: "var(--code-comment)", fontStyle: "italic" },
  { tag: tags.function(tags.variableName), color: "var(--code-function)" },
  { tag: tags.operator, color: "var(--code-operator)" },
]);

/** Language and colours of the editor. */
export const smplLanguage = [new LanguageSupport(language), syntaxHighlighting(colours)];
