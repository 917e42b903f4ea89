"""The check of plain English finds departures from the rules that it lists, and no others."""

import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def prose() -> ModuleType:
    loader = SourceFileLoader("prose", str(ROOT / ".ci/prose"))
    spec = importlib.util.spec_from_loader("prose", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["prose"] = module
    loader.exec_module(module)
    return module


LONG = " ".join(["word"] * 31)


@pytest.mark.parametrize(
    ("name", "text", "rules"),
    [
        ("a.md", "Short sentence. Another one.\n", []),
        ("a.md", f"{LONG}.\n", ["sentence"]),
        ("a.md", f"{' '.join(['word'] * 20)}. {' '.join(['Word'] * 20)}.\n", ["width"]),
        ("a.md", "The table stands beside the text.\n", ["idiom", "idiom"]),
        ("a.md", "SI stands for a system; there is no other. `is none` and [told](told.md)\n", ["idiom"]),
        ("a.md", f"```\n{LONG} stands beside\n```\n", []),
        ("a.md", f"| short | {LONG} |\n|---|---|\n", ["sentence"]),
        ("a.rs", "/// What has bounds.\nfn bounded() {}\n", ["opening"]),
        ("a.rs", "/// Bounded quantities.\n///\n/// Which ones: all.\nfn bounded() {}\n", []),
        ("a.rs", 'const TEXT: &str = "`x` is no function"; // a short comment\n', ["idiom"]),
        ("a.rs", f"// {'long ' * 25}\n", ["width"]),
        ("a.rs", f'const TEXT: &str = "{"x" * 110}";\n', []),
        ("a.py", 'def f():\n    """Where to look."""\n    raise ValueError("x is at fault")\n', ["opening", "idiom"]),
        ("a.py", f'def f():\n    """Items:\n\n    - {LONG[:84]}.\n    - {LONG[:84]}.\n    """\n', []),
        (
            "tests/a.py",
            f'def test_f():\n    """What is tested: {"x" * 99}."""\n    assert f("x is no y")\n',
            ["opening"],
        ),
        ("a.py", "if x is None:  # the default\n    y = f'{x} is None'\n", []),
    ],
)
def test_departures_from_the_rules_are_found(
    prose: ModuleType, tmp_path: Path, name: str, text: str, rules: list[str]
) -> None:
    prose.ROOT = tmp_path
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(text)
    assert sorted(one.rule for one in prose.check(tmp_path / name)) == sorted(rules)
