//! Ports with flows, arrays of ports, grids of instances, packages and switches: values against closed forms and matrix exponentials.

mod shell;

use shell::{beside, file, name, smpl, status, text};

const NETWORKS: &str = include_str!("networks.eq");
const PACKAGES: &str = include_str!("packages.eq");

/// Runs the tests of a text.
fn passes(test: &str, source: &str) {
    let path = file(test, "m.eq", source);
    let output = smpl(&["test", name(&path)]);
    assert_eq!(status(&output), 0, "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn networks_of_flows_have_the_trajectories_of_their_matrices_by_every_method() {
    for method in ["ida", "rosenbrock"] {
        passes(&format!("networks_{method}"), &NETWORKS.replace("rtol = 1e-10", &format!("rtol = 1e-10, method = {method}")));
    }
}

#[test]
fn a_network_of_defined_flows_is_explicit() {
    let path = file("networks_explicit", "m.eq", NETWORKS.split("# A wall of two layers").next().expect("a part"));
    let out = text(&smpl(&["compile", name(&path)]).stdout).to_owned();
    assert!(!out.contains("solved: ") || out.contains("0 solved"), "{out}");
    assert_eq!(status(&smpl(&["simulate", name(&path), "--method", "explicit"])), 0);
}

#[test]
fn packages_switches_and_arrays_are_those_of_each_instance() {
    passes("packages", PACKAGES);
    passes(
        "packages_ideal",
        &PACKAGES
            .replace("choice thermo = Square | Ideal", "choice thermo = Ideal | Square")
            .replace("expect T3.y[b] within 1e-12 of 4/9", "expect T3.y[b] within 1e-12 of 1/3")
            .replace("expect T3.n[b] within 1e-8 of 4/(1 + 4*0.25*5)*1 [mol]", "expect T3.n[b] within 1e-8 of 4*exp(-0.5)*1 [mol]"),
    );
}

#[test]
fn a_network_as_json_has_its_flows() {
    let path = file("networks_json", "m.eq", NETWORKS);
    let json = beside(&path, "m.json");
    assert_eq!(status(&smpl(&["export", name(&path), "--to", "json", "-o", name(&json)])), 0);
    let read: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("a file")).expect("JSON");
    let ports = read["ports"].as_array().expect("ports");
    let port = |name: &str| ports.iter().find(|port| port["name"] == name).unwrap_or_else(|| panic!("{name}"));
    assert_eq!(port("hub.n[west]")["members"][1]["flow"], true);
    assert_eq!(port("r[2,3].p")["members"][0]["flow"], false);
}
