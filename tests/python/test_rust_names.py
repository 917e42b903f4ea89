"""Names of types in the Rust crates, and matches over statements."""

import re
from collections import Counter

from test_module_arrows import ROOT, tokens

CRATES = ["dsl", "compiler", "compiler/analysis", "runtime", "runtime/tools", "python"]

# Names that four types or more have, with their number, which only falls: a type that would raise it needs a name that
# says more.
HOMONYMS = {
    "Block": 6,
    "Given": 6,
    "Line": 6,
    "Piece": 6,
    "Plan": 6,
    "Point": 6,
    "Read": 6,
    "Start": 6,
    "Cell": 5,
    "Entry": 5,
    "Matrix": 5,
    "Request": 5,
    "Role": 5,
    "Row": 5,
    "Run": 5,
    "Source": 5,
    "Target": 5,
    "Writer": 5,
    "Body": 4,
    "Columns": 4,
    "Element": 4,
    "End": 4,
    "Extents": 4,
    "File": 4,
    "Input": 4,
    "Inputs": 4,
    "Key": 4,
    "Known": 4,
    "Member": 4,
    "Pace": 4,
    "Parts": 4,
    "Phase": 4,
    "Rows": 4,
    "Search": 4,
    "Settings": 4,
    "Shape": 4,
    "State": 4,
    "Symbol": 4,
    "Term": 4,
    "Terms": 4,
}


def sources():
    for crate in CRATES:
        for file in sorted((ROOT / crate / "src").rglob("*.rs")):
            if file.stem != "tests":
                yield file


def types(words):
    """Names of the types that a text defines, other than associated types."""
    blocks, opening = [], ""
    for at, word in enumerate(words):
        if word in ("impl", "trait") and words[at - 1] not in (":", "->", "(", ",", "<", "=", "&"):
            opening = word
        elif word == "{":
            blocks.append(opening)
            opening = ""
        elif word == "}" and blocks:
            blocks.pop()
        if word in ("struct", "enum", "trait", "union") or (word == "type" and not set(blocks) & {"impl", "trait"}):
            name = words[at + 1]
            if name[0].isupper():
                yield name


def test_names_of_types_do_not_get_more_meanings():
    counts = Counter(name for file in sources() for name in types(tokens(file.read_text())))
    found = {name: count for name, count in counts.items() if count >= 4}
    more = {name: count for name, count in found.items() if count > HOMONYMS.get(name, 3)}
    fewer = {name: found.get(name, 3) for name, count in HOMONYMS.items() if found.get(name, 3) < count}
    assert not more, "types with the name of three others or more: choose a name that says more"
    assert not fewer, "fewer types have these names: lower the numbers in HOMONYMS"


def test_associated_types_are_not_counted():
    text = "struct A; trait B { type Number; } impl B for A { type Number = f64; } type C = f64; fn f() { enum D {} }"
    assert list(types(tokens(text))) == ["A", "B", "C", "D"]


def arms(text):
    """The line of each `match` of a text, and its patterns without what they hold or lead to."""
    text = re.sub(r"//[^\n]*", "", text)
    for head in re.finditer(r"\bmatch\b[^{};]*\{", text):
        depth, at, pattern, patterns, inside = 1, head.end(), "", [], False
        while depth and at < len(text):
            before, depth = depth, depth + (text[at] in "{([") - (text[at] in "})]")
            if inside:
                # What an arm leads to ends with a comma, or with the block that it is.
                inside = not (depth == 1 and (text[at] == "," or (text[at] == "}" and before == 2)))
            elif before == depth == 1 and text.startswith("=>", at):
                patterns.append(pattern.strip(" \n,"))
                pattern, inside = "", True
            elif before == depth == 1:
                pattern += text[at]
            at += 1
        yield text.count("\n", 0, head.start()) + 1, patterns


def test_matches_over_many_kinds_of_statement_name_all_of_them():
    for file in sources():
        text = file.read_text()
        if "StatementKind" not in text:
            continue
        for line, patterns in arms(text):
            kinds = set(re.findall(r"StatementKind::(\w+)", " ".join(patterns)))
            rest = [pattern for pattern in patterns if re.fullmatch(r"(_|[a-z]\w*)(\s+if\b.*)?", pattern.strip())]
            assert len(kinds) <= 10 or not rest, f"{file}:{line}: name the other kinds, or the next one is forgotten"
