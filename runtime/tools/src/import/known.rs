//! Elements and attributes of SBML and its packages: those with an unknown meaning are refused,
//! never ignored.

use roxmltree::Node;

use super::xml::{Fault, children, fault, tag};

/// The namespace of MathML.
pub(super) const MATHML: &str = "http://www.w3.org/1998/Math/MathML";

/// Attributes that every element may have.
const COMMON: [&str; 4] = ["id", "metaid", "name", "sboTerm"];

/// Attributes of MathML.
const MATH: [&str; 9] = ["base", "class", "definitionURL", "encoding", "href", "id", "style", "type", "xref"];

/// Elements with their own attributes.
const ATTRIBUTES: [(&str, &[&str]); 19] = [
    ("sbml", &["level", "version"]),
    ("model", &["substanceUnits", "timeUnits", "volumeUnits", "areaUnits", "lengthUnits", "extentUnits", "conversionFactor"]),
    ("unit", &["kind", "exponent", "scale", "multiplier", "offset"]),
    ("compartment", &["compartmentType", "spatialDimensions", "size", "units", "outside", "constant"]),
    (
        "species",
        &[
            "speciesType",
            "compartment",
            "initialAmount",
            "initialConcentration",
            "substanceUnits",
            "spatialSizeUnits",
            "hasOnlySubstanceUnits",
            "boundaryCondition",
            "charge",
            "constant",
            "conversionFactor",
        ],
    ),
    ("parameter", &["value", "units", "constant"]),
    ("localParameter", &["value", "units"]),
    ("initialAssignment", &["symbol"]),
    ("assignmentRule", &["variable"]),
    ("rateRule", &["variable"]),
    ("reaction", &["reversible", "fast", "compartment"]),
    ("speciesReference", &["species", "stoichiometry", "denominator", "constant"]),
    ("modifierSpeciesReference", &["species"]),
    ("kineticLaw", &["timeUnits", "substanceUnits"]),
    ("event", &["useValuesFromTriggerTime", "timeUnits"]),
    ("trigger", &["initialValue", "persistent"]),
    ("eventAssignment", &["variable"]),
    // A spelling of Level 2 Version 1.
    ("specieReference", &["species", "stoichiometry", "denominator"]),
    ("message", &[]),
];

/// Name of a package by its namespace.
pub(super) fn package(namespace: &str) -> &str {
    let name = |part: &&str| !part.starts_with("version") && !part.is_empty();
    namespace.rsplit('/').find(name).unwrap_or(namespace)
}

/// Checks all elements but notes and annotations; `optional` are the namespaces of packages that do
/// not change the equations.
pub(super) fn check(root: Node<'_, '_>, optional: &[&str]) -> Result<(), Fault> {
    let own = root.tag_name().namespace();
    let mut stack = vec![root];
    while let Some(node) = stack.pop() {
        match node.tag_name().namespace() {
            namespace if namespace == own => attributes(node)?,
            Some(MATHML) => math_attributes(node)?,
            Some(namespace) => {
                of_package(node, package(namespace), optional.contains(&namespace))?;
                continue;
            }
            None => return Err(fault(node, format!("`{}` has no namespace", tag(node)))),
        }
        stack.extend(children(node).filter(|n| !matches!(tag(*n), "notes" | "annotation" | "annotation-xml" | "message")));
    }
    Ok(())
}

fn attributes(node: Node<'_, '_>) -> Result<(), Fault> {
    let own = ATTRIBUTES.iter().find(|(name, _)| *name == tag(node)).map_or(&[][..], |(_, known)| known);
    let mut names = node.attributes().filter(|a| a.namespace().is_none()).map(|a| a.name());
    match names.find(|name| !COMMON.contains(name) && !own.contains(name)) {
        Some(name) => Err(fault(node, format!("the attribute `{name}` of `{}` is not known", tag(node)))),
        None => Ok(()),
    }
}

fn math_attributes(node: Node<'_, '_>) -> Result<(), Fault> {
    let mut names = node.attributes().filter(|a| a.namespace().is_none()).map(|a| a.name());
    let known = |name: &&str| MATH.contains(name) || *name == "units" && tag(node) == "cn";
    match names.find(|name| !known(name)) {
        Some(name) => Err(fault(node, format!("the attribute `{name}` of `{}` in MathML is not known", tag(node)))),
        None => Ok(()),
    }
}

/// An element of a package, with all that it holds.
fn of_package(node: Node<'_, '_>, name: &str, optional: bool) -> Result<(), Fault> {
    if !optional {
        return Err(fault(node, format!("`{}` of the package `{name}`, which is not declared with `required=\"false\"`", tag(node))));
    }
    let changes = |n: &Node<'_, '_>| matches!(tag(*n), "listOfSubmodels" | "listOfReplacedElements" | "replacedBy");
    match node.descendants().filter(Node::is_element).find(changes) {
        Some(part) => Err(fault(part, format!("`{}` of the package `{name}` changes the equations and is not read", tag(part)))),
        None => Ok(()),
    }
}
