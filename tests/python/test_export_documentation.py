"""docs/export.md and the header show the actual results."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.S | re.M)


def test_the_python_of_the_page_runs_in_its_order(tmp_path):
    for package in ("casadi", "do_mpc", "jax"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    # What needs FMPy is tested with the FMUs.
    code = "\n".join(block for block in blocks("python") if "fmpy" not in block)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "(4096, 3)" in done.stdout


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_c_of_the_page_compiles_and_gives_the_residual(tmp_path):
    smpl.export.write(smpl.compile("reactor"), "c", tmp_path / "reactor.c")
    (code,) = blocks("c")
    include, rest = code.split("\n", 1)
    declarations = [line for line in rest.splitlines() if line.startswith("double")]
    statements = [line for line in rest.splitlines() if line and not line.startswith("double")]
    program = [include, "#include <stdio.h>", *declarations, "int main(void) {", "const double t = 0.0, cj = 1.0;"]
    program += ["for (int i = 0; i < REACTOR_STATES; ++i) y[i] = reactor_states_table[i].nominal;"]
    program += ["for (int i = 0; i < REACTOR_ACTIONS; ++i) u[i] = reactor_actions_table[i].nominal;"]
    program += [*statements, 'for (int i = 0; i < REACTOR_UNKNOWNS; ++i) printf("%.17g\\n", f[i]);', "return 0; }"]
    (tmp_path / "main.c").write_text("\n".join(program))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "main.c", "reactor.c", "-o", "main", "-lm"]
    done = subprocess.run(["cc", *flags], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = [float(x) for x in subprocess.run([tmp_path / "main"], capture_output=True, text=True).stdout.split()]
    model = smpl.compile("reactor")
    nominal = [element["nominal"] for element in smpl.export.json(model)["elements"]["states"]]
    expected = model.residual(0.0, nominal, [0.0] * 3, model.native.defaults("action"))
    assert found == pytest.approx(list(expected), rel=1e-12, abs=1e-15)


def test_every_target_of_the_page_is_one_of_the_command_and_the_other_way_round(tmp_path):
    endings = {"casadi": "py", "jax": "py", "kernel": "c"}
    named = set(re.findall(r"^\| `(casadi|jax|c|kernel|json|fmu)` \|", PAGE, re.M))
    for target in named:
        file = tmp_path / f"out.{endings.get(target, target)}"
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "smpl",
                "export",
                str(ROOT / "models" / "reactor.eq"),
                "--to",
                target,
                "-o",
                str(file),
            ],
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert file.exists()
        assert str(file) in done.stdout
    done = subprocess.run(
        [sys.executable, "-m", "smpl", "export", "x.eq", "--to", "fortran"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert set(re.search(r"known: ([\w, ]+)", done.stderr)[1].split(", ")) == named


def test_nothing_is_written_where_an_export_fails(tmp_path):
    model = tmp_path / "tank.eq"
    model.write_text("model Tank\nstate h = 1\n")

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "smpl", "export", *arguments], capture_output=True, text=True, cwd=tmp_path
        )

    assert run("tank.eq", "--to", "json", "-o", "out.json").returncode == 1
    assert run("tank.eq", "--to", "json", "-o", "tank.eq").returncode == 1
    assert model.read_text() == "model Tank\nstate h = 1\n"
    shutil.copy(ROOT / "models" / "reactor.eq", tmp_path)
    several = run("reactor.eq", "--to", "c", "-o", "out")
    assert several.returncode == 1
    assert "name the first one `NAME.c`" in several.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["reactor.eq", "tank.eq"]
