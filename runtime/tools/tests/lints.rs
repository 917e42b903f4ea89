//! `smpl lint`: legal texts that are unwise, and how a lint is silenced.

mod shell;

use shell::{file, name, smpl, status, text};

const HEAD: &str = "action q = 1 in 0..2\nstate x = 1 in 0..2\neq d/dt x = (q - x) / 1 [s]\nobserve x\nreward r default = -x\n\
                    episode { step = 1 [s], max_steps = 3 }\n";

fn lint(more: &str, options: &[&str]) -> (i32, String, String) {
    let path = file("lints", "m.eq", format!("{HEAD}{more}"));
    let output = smpl(&[&["lint", name(&path)], options].concat());
    (status(&output), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_model_without_lints_is_said_to_have_none() {
    let (status, out, err) = lint("", &["--deny"]);
    assert!(status == 0 && out.contains("no warnings") && err.is_empty(), "{out}{err}");
}

#[test]
fn each_lint_has_its_code_its_place_and_its_exit_status() {
    for (more, code, message) in [
        ("let T : K = 20 [K] + 273.15 [K]\n", "W0302", "273.15 is the zero of the Celsius scale"),
        ("def f(T) = 8.314*T\nlet y = f(x)\n", "W0302", "8.314 is the molar gas constant"),
        (
            "reaction r: A -> B rate 8.314*c[A]/1 [s]\nset s = { A, B }\nstate c[s] = 1 in 0..2 scale 1\neq d/dt c[i] = source[i] for i in s\n",
            "W0302",
            "8.314 is the molar gas constant",
        ),
        ("event low when x < 0.5\n", "W0605", "nothing happens at the event `low`"),
        ("fail high event x >= 3\n", "W0606", "the event `high` is outside the bounds of `x`, 0..2"),
        ("success low event -1 > x\n", "W0606", "the event `low` is outside the bounds of `x`"),
        ("state y = 1e-7 in 0..1\neq d/dt y = -y/1 [s]\n", "W0607", "`y` starts at 0.0000001 and is scaled by 1"),
        ("observe seen = x in 0..inf\n", "W0608", "the observation `seen` is bounded on one side only"),
        ("param unused = 3\n", "W0202", "unused"),
    ] {
        let (status, _, err) = lint(more, &[]);
        assert!(status == 0 && err.contains(code) && err.contains(message), "{more}{err}");
        assert_eq!(lint(more, &["--deny"]).0, 1, "{more}");
        let (line, rest) = more.trim_end().split_once('\n').map_or((more.trim_end(), ""), |(line, rest)| (line, rest));
        let (status, out, err) = lint(&format!("{line}    # allow {code}\n{rest}\n"), &["--deny"]);
        assert!(status == 0 && out.contains("no warnings"), "{more}{err}");
        assert_eq!(lint(&format!("# allow {code}: for a reason\n{line}\n{rest}\n"), &["--deny"]).0, 0, "{more}");
        assert_eq!(lint(&format!("{line}    # allow W9999\n{rest}\n"), &["--deny"]).0, 1, "{more}");
    }
}

#[test]
fn declared_constants_and_scales_are_no_lints() {
    let more = "param R : J/(mol K) = 8.314\nlet y : J/mol = R*kelvin(20 [degC])*x\nstate z = 1e-7 in 0..1 scale 1e-7\neq d/dt z = -z/1 [s]\n\
                success done event x >= 1.5\n";
    let (status, out, err) = lint(more, &["--deny"]);
    assert!(status == 0 && out.contains("no warnings"), "{out}{err}");
}

#[test]
fn an_invalid_model_is_status_1() {
    assert_eq!(lint("let y = zz\n", &[]).0, 1);
}
