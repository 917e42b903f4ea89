//! `terminalsAndIcons.xml`: a terminal for each port of a component.

use std::fmt::Write as _;

use super::Parts;
use super::description::escaped;
use super::variables::{FmuRole, Variable};
use crate::model::PortMember;

/// The terminals; `None` where no component has ports.
///
/// Members of connected ports are equal, or flows that sum to zero. An
/// importer connects inputs and outputs: a member is the input that it is equal to, or else the
/// output that shows it.
pub(super) fn describe(parts: &Parts<'_>) -> Option<String> {
    let ports = &parts.sheet.model.interface.ports;
    if ports.is_empty() {
        return None;
    }
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiTerminalsAndIcons fmiVersion=\"3.0\">\n  <Terminals>\n");
    for port in ports {
        let (name, kind) = (escaped(&port.name), escaped(&port.connector));
        let _ = writeln!(xml, "    <Terminal name=\"{name}\" matchingRule=\"plug\" terminalKind=\"_smpl_{kind}\">");
        for member in &port.members {
            let Some(variable) = variable(&parts.variables.list, member) else { continue };
            let kind = if member.flow { "inflow" } else { "signal" };
            let (of, name) = (escaped(&variable.name), escaped(&member.name));
            let _ = writeln!(xml, "      <TerminalMemberVariable variableName=\"{of}\" memberName=\"{name}\" variableKind=\"{kind}\"/>");
        }
        xml += "    </Terminal>\n";
    }
    Some(xml + "  </Terminals>\n</fmiTerminalsAndIcons>\n")
}

fn variable<'v>(list: &'v [Variable], member: &PortMember) -> Option<&'v Variable> {
    let named = |name: &String, kind: FmuRole| list.iter().find(|v| v.kind == kind && v.name == *name);
    member.equals.as_ref().and_then(|name| named(name, FmuRole::Input)).or_else(|| named(&member.output, FmuRole::Output))
}
