//! An SBML document: what of its XML carries meaning, checked element by element. What is not known
//! is refused, never passed over.

use std::collections::{BTreeMap, HashMap};

use roxmltree::{Document, Node};

use super::known;
use super::math::{self, Functions, Math};
use super::xml::{Fault, attribute, children, fault, number, tag};

/// A model as it is written: a field for each list of the standard, under its name.
#[derive(Default)]
pub(super) struct Sbml {
    pub(super) level: u32,
    pub(super) version: u32,
    pub(super) id: String,
    pub(super) name: String,
    /// Notes of the model, as plain text.
    pub(super) notes: String,
    /// Packages that are not needed and not carried.
    pub(super) packages: Vec<String>,
    pub(super) substance: Option<String>,
    pub(super) extent: Option<String>,
    pub(super) volume: Option<String>,
    pub(super) area: Option<String>,
    pub(super) length: Option<String>,
    pub(super) time: Option<String>,
    pub(super) factor: Option<String>,
    /// Products of (kind, exponent, scale, multiplier) by id.
    pub(super) units: BTreeMap<String, Vec<UnitPart>>,
    pub(super) functions: Functions,
    /// Compartments, species, parameters, and stoichiometries with an id, in their order.
    pub(super) symbols: Vec<Symbol>,
    pub(super) initial: HashMap<String, Math>,
    pub(super) rules: Vec<Rule>,
    pub(super) reactions: Vec<Reaction>,
    pub(super) events: Vec<Event>,
    pub(super) constraints: Vec<(usize, Math)>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct UnitPart {
    pub(super) kind: String,
    pub(super) exponent: f64,
    pub(super) scale: i32,
    pub(super) multiplier: f64,
}

/// Kind of a symbol.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SymbolRole {
    Compartment {
        dimensions: f64,
        /// It has no size: amounts in it are not divided.
        point: bool,
    },
    Species {
        compartment: String,
        /// The symbol is the amount, not the concentration.
        amount: bool,
        boundary: bool,
        /// The initial value is an amount.
        starts_as_amount: bool,
        substance: Option<String>,
        factor: Option<String>,
    },
    Parameter,
    Stoichiometry,
}

#[derive(Clone, Debug)]
pub(super) struct Symbol {
    pub(super) at: usize,
    pub(super) id: String,
    pub(super) name: String,
    pub(super) kind: SymbolRole,
    pub(super) value: Option<f64>,
    pub(super) constant: bool,
    pub(super) unit: Option<String>,
}

pub(super) enum Target {
    Assignment(String),
    Rate(String),
    Algebraic,
}

pub(super) struct Rule {
    pub(super) at: usize,
    pub(super) target: Target,
    pub(super) math: Math,
}

/// A reactant or product: species, number, and what it is called.
pub(super) struct SpeciesReference {
    pub(super) at: usize,
    pub(super) species: String,
    pub(super) number: Math,
    /// -1 for a reactant, 1 for a product.
    pub(super) sign: f64,
}

pub(super) struct Reaction {
    pub(super) at: usize,
    pub(super) id: String,
    pub(super) name: String,
    pub(super) reversible: bool,
    /// It is in equilibrium at all times.
    pub(super) fast: bool,
    pub(super) parts: Vec<SpeciesReference>,
    pub(super) rate: Math,
}

pub(super) struct Event {
    pub(super) at: usize,
    pub(super) id: String,
    pub(super) name: String,
    pub(super) trigger: Math,
    /// The condition counts as true before the start.
    pub(super) starts_true: bool,
    /// A triggered event runs even if its condition ceases to hold before.
    pub(super) persistent: bool,
    /// The values are those of the time of the trigger, not of the execution.
    pub(super) early_values: bool,
    pub(super) delay: Option<Math>,
    pub(super) priority: Option<Math>,
    pub(super) assignments: Vec<(usize, String, Math)>,
}

impl Event {
    /// The symbols that it sets.
    pub(super) fn targets(&self) -> impl Iterator<Item = &str> {
        self.assignments.iter().map(|(_, id, _)| id.as_str())
    }
}

fn numeric(node: Node<'_, '_>, name: &str) -> Result<Option<f64>, Fault> {
    let value = attribute(node, name).map(|text| number(node, text)).transpose()?;
    // An unset value of some writers.
    Ok(value.filter(|x| !x.is_nan()))
}

fn flag(node: Node<'_, '_>, name: &str, usual: bool) -> Result<bool, Fault> {
    match attribute(node, name) {
        None => Ok(usual),
        Some("true" | "1") => Ok(true),
        Some("false" | "0") => Ok(false),
        Some(other) => Err(fault(node, format!("`{name}` is `true` or `false`, not `{other}`"))),
    }
}

fn needed(node: Node<'_, '_>, name: &str) -> Result<String, Fault> {
    attribute(node, name).map(str::to_owned).ok_or_else(|| fault(node, format!("`{}` without `{name}`", tag(node))))
}

fn owned(node: Node<'_, '_>, name: &str) -> Option<String> {
    attribute(node, name).map(str::to_owned)
}

/// The children that carry meaning: not notes, annotations, or elements of packages that are not
/// needed.
fn meaning<'a, 'i>(node: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    let own = node.tag_name().namespace();
    children(node).filter(move |n| {
        let math = n.tag_name().name() == "math";
        (n.tag_name().namespace() == own || math) && !matches!(tag(*n), "notes" | "annotation")
    })
}

fn unknown(node: Node<'_, '_>, inside: &str) -> Fault {
    fault(node, format!("`{}` in `{inside}` is not known", tag(node)))
}

/// Refuses a second element for one id; `before` is the first one.
fn once<T>(node: Node<'_, '_>, before: Option<T>) -> Result<(), Fault> {
    match before {
        Some(_) => Err(fault(node, format!("a second `{}` for one id", tag(node)))),
        None => Ok(()),
    }
}

/// The child of this name; a second one is refused.
fn only<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Result<Option<Node<'a, 'i>>, Fault> {
    let mut found = children(node).filter(|n| tag(*n) == name);
    let first = found.next();
    match found.next() {
        Some(second) => Err(fault(second, format!("a second `{name}` in `{}`", tag(node)))),
        None => Ok(first),
    }
}

fn math_of(node: Node<'_, '_>) -> Result<Option<Math>, Fault> {
    only(node, "math")?.map(math::read).transpose()
}

fn math_needed(node: Node<'_, '_>) -> Result<Math, Fault> {
    math_of(node)?.ok_or_else(|| fault(node, format!("`{}` without `math`", tag(node))))
}

/// Text of the notes: words in one line.
fn notes(node: Node<'_, '_>) -> String {
    let Some(notes) = children(node).find(|n| tag(*n) == "notes") else { return String::new() };
    let words: Vec<&str> = notes.descendants().filter(|n| n.is_text()).filter_map(|n| n.text()).flat_map(str::split_whitespace).collect();
    words.join(" ")
}

/// Reads a document.
pub(super) fn read(document: &Document<'_>) -> Result<Sbml, Fault> {
    let root = document.root_element();
    if tag(root) != "sbml" {
        return Err(fault(root, format!("not SBML: the outermost element is `{}`, not `sbml`", tag(root))));
    }
    let whole = |name: &str| needed(root, name)?.parse::<u32>().map_err(|_| fault(root, format!("`{name}` is not a whole number")));
    let (level, version) = (whole("level")?, whole("version")?);
    if !(2..=3).contains(&level) {
        return Err(fault(root, format!("SBML Level {level} is not read, Levels 2 and 3 are: libSBML converts between them")));
    }
    let mut sbml = Sbml { level, version, ..Sbml::default() };
    let mut optional = vec![];
    for attribute in root.attributes().filter(|a| a.name() == "required") {
        let Some(namespace) = attribute.namespace() else { continue };
        let name = known::package(namespace);
        if !matches!(attribute.value(), "false" | "0") {
            return Err(fault(root, format!("the package `{name}` is required and not read: only the core of SBML is")));
        }
        optional.push(namespace);
        sbml.packages.push(name.to_owned());
    }
    known::check(root, &optional)?;
    let mut models = meaning(root);
    let model = models.next().filter(|n| tag(*n) == "model").ok_or_else(|| fault(root, "no `model` in the document"))?;
    if let Some(second) = models.next() {
        return Err(fault(second, format!("a second element in `sbml`: `{}`", tag(second))));
    }
    sbml.id = owned(model, "id").unwrap_or_default();
    sbml.name = owned(model, "name").unwrap_or_default();
    sbml.notes = notes(model);
    read_model(&mut sbml, model)?;
    points(&mut sbml);
    Ok(sbml)
}

/// Makes points of compartments without dimensions: in Level 2, and in Level 3 where nothing gives
/// their size. There they are compartments as any other.
fn points(sbml: &mut Sbml) {
    for symbol in &mut sbml.symbols {
        let SymbolRole::Compartment { dimensions, point } = &mut symbol.kind else { continue };
        let ruled = sbml.rules.iter().any(|r| matches!(&r.target, Target::Assignment(id) if *id == symbol.id));
        let given = symbol.value.is_some() || ruled || sbml.initial.contains_key(&symbol.id);
        if *dimensions == 0.0 && (sbml.level == 2 || !given) {
            *point = true;
            symbol.value = Some(1.0);
        }
    }
}

fn read_model(sbml: &mut Sbml, model: Node<'_, '_>) -> Result<(), Fault> {
    sbml.substance = owned(model, "substanceUnits");
    sbml.extent = owned(model, "extentUnits");
    sbml.volume = owned(model, "volumeUnits");
    sbml.area = owned(model, "areaUnits");
    sbml.length = owned(model, "lengthUnits");
    sbml.time = owned(model, "timeUnits");
    sbml.factor = owned(model, "conversionFactor");
    for list in meaning(model) {
        for item in meaning(list) {
            match (tag(list), tag(item)) {
                ("listOfFunctionDefinitions", "functionDefinition") => {
                    // A function without an expression may not be called.
                    if let Some(math) = only(item, "math")? {
                        once(item, sbml.functions.insert(needed(item, "id")?, math::read_function(math)?))?;
                    }
                }
                ("listOfUnitDefinitions", "unitDefinition") => {
                    once(item, sbml.units.insert(needed(item, "id")?, unit_parts(item)?))?;
                }
                // Types of compartments and species group them and say nothing of equations.
                ("listOfCompartmentTypes", "compartmentType") | ("listOfSpeciesTypes", "speciesType") => {}
                ("listOfCompartments", "compartment") => sbml.symbols.push(compartment(item)?),
                ("listOfSpecies", "species") => sbml.symbols.push(species(item)?),
                ("listOfParameters", "parameter") => sbml.symbols.push(parameter(item)?),
                ("listOfInitialAssignments", "initialAssignment") => {
                    if let Some(math) = math_of(item)? {
                        once(item, sbml.initial.insert(needed(item, "symbol")?, math))?;
                    }
                }
                ("listOfRules", _) => sbml.rules.extend(rule(item)?),
                ("listOfConstraints", "constraint") => sbml.constraints.extend(math_of(item)?.map(|math| (item.range().start, math))),
                ("listOfReactions", "reaction") => {
                    let made = reaction(sbml, item)?;
                    sbml.reactions.push(made);
                }
                ("listOfEvents", "event") => {
                    let number = sbml.events.len();
                    sbml.events.extend(event(item, number)?);
                }
                (inside, _) => return Err(unknown(item, inside)),
            }
        }
    }
    Ok(())
}

fn unit_parts(definition: Node<'_, '_>) -> Result<Vec<UnitPart>, Fault> {
    let parts = meaning(definition).flat_map(meaning);
    parts
        .map(|unit| {
            if let Some(offset) = numeric(unit, "offset")?.filter(|x| *x != 0.0) {
                return Err(fault(unit, format!("a unit with an offset ({offset}) has no counterpart")));
            }
            let scale = numeric(unit, "scale")?.unwrap_or(0.0);
            if scale.fract() != 0.0 || scale.abs() > 300.0 {
                return Err(fault(unit, "`scale` is a whole number"));
            }
            Ok(UnitPart {
                kind: needed(unit, "kind")?,
                exponent: numeric(unit, "exponent")?.unwrap_or(1.0),
                scale: scale as i32,
                multiplier: numeric(unit, "multiplier")?.unwrap_or(1.0),
            })
        })
        .collect()
}

fn compartment(node: Node<'_, '_>) -> Result<Symbol, Fault> {
    let dimensions = numeric(node, "spatialDimensions")?.unwrap_or(3.0);
    Ok(Symbol {
        at: node.range().start,
        id: needed(node, "id")?,
        name: owned(node, "name").unwrap_or_default(),
        kind: SymbolRole::Compartment { dimensions, point: false },
        value: numeric(node, "size")?,
        constant: flag(node, "constant", true)?,
        unit: owned(node, "units"),
    })
}

fn species(node: Node<'_, '_>) -> Result<Symbol, Fault> {
    let (amount, concentration) = (numeric(node, "initialAmount")?, numeric(node, "initialConcentration")?);
    if amount.is_some() && concentration.is_some() {
        return Err(fault(node, "a species has an `initialAmount` or an `initialConcentration`, not both"));
    }
    let kind = SymbolRole::Species {
        compartment: needed(node, "compartment")?,
        amount: flag(node, "hasOnlySubstanceUnits", false)?,
        boundary: flag(node, "boundaryCondition", false)?,
        starts_as_amount: amount.is_some(),
        substance: owned(node, "substanceUnits"),
        factor: owned(node, "conversionFactor"),
    };
    Ok(Symbol {
        at: node.range().start,
        id: needed(node, "id")?,
        name: owned(node, "name").unwrap_or_default(),
        kind,
        value: amount.or(concentration),
        constant: flag(node, "constant", false)?,
        unit: None,
    })
}

fn parameter(node: Node<'_, '_>) -> Result<Symbol, Fault> {
    Ok(Symbol {
        at: node.range().start,
        id: needed(node, "id")?,
        name: owned(node, "name").unwrap_or_default(),
        kind: SymbolRole::Parameter,
        value: numeric(node, "value")?,
        constant: flag(node, "constant", true)?,
        unit: owned(node, "units"),
    })
}

fn rule(node: Node<'_, '_>) -> Result<Option<Rule>, Fault> {
    let target = match tag(node) {
        "assignmentRule" => Target::Assignment(needed(node, "variable")?),
        "rateRule" => Target::Rate(needed(node, "variable")?),
        "algebraicRule" => Target::Algebraic,
        _ => return Err(unknown(node, "listOfRules")),
    };
    // A rule without an expression says nothing.
    Ok(math_of(node)?.map(|math| Rule { at: node.range().start, target, math }))
}

fn reaction(sbml: &mut Sbml, node: Node<'_, '_>) -> Result<Reaction, Fault> {
    let id = needed(node, "id")?;
    let mut parts = vec![];
    let mut rate = None;
    for item in meaning(node) {
        match tag(item) {
            "listOfReactants" | "listOfProducts" => {
                let sign = if tag(item) == "listOfReactants" { -1.0 } else { 1.0 };
                for part in meaning(item) {
                    parts.push(stoichiometry(sbml, part, sign)?);
                }
            }
            "listOfModifiers" => {}
            "kineticLaw" if rate.is_some() => return Err(fault(item, format!("a second `kineticLaw` in the reaction `{id}`"))),
            "kineticLaw" => rate = Some(kinetic_law(sbml, item, &id)?),
            _ => return Err(unknown(item, "reaction")),
        }
    }
    let rate = rate.ok_or_else(|| fault(node, format!("the reaction `{id}` has no kinetic law: its rate is not known")))?;
    let (name, reversible) = (owned(node, "name").unwrap_or_default(), flag(node, "reversible", true)?);
    Ok(Reaction { at: node.range().start, id, name, reversible, fast: flag(node, "fast", false)?, parts, rate })
}

fn stoichiometry(sbml: &mut Sbml, node: Node<'_, '_>, sign: f64) -> Result<SpeciesReference, Fault> {
    let species = needed(node, "species")?;
    let mut value = numeric(node, "stoichiometry")?;
    if sbml.level == 2 {
        let denominator = numeric(node, "denominator")?.unwrap_or(1.0);
        value = Some(value.unwrap_or(1.0) / denominator);
    }
    if let Some(other) = meaning(node).find(|n| tag(*n) != "stoichiometryMath") {
        return Err(unknown(other, tag(node)));
    }
    let math = only(node, "stoichiometryMath")?.map(math_needed).transpose()?;
    let number = match (math, owned(node, "id")) {
        (Some(math), _) => math,
        (None, Some(id)) => {
            let kind = SymbolRole::Stoichiometry;
            let constant = flag(node, "constant", true)?;
            sbml.symbols.push(Symbol { at: node.range().start, id: id.clone(), name: String::new(), kind, value, constant, unit: None });
            Math::Name(id)
        }
        (None, None) => {
            let value = value.ok_or_else(|| fault(node, format!("the stoichiometry of `{species}` is not known")))?;
            Math::Number(value, None)
        }
    };
    Ok(SpeciesReference { at: node.range().start, species, number, sign })
}

/// The rate, with the reaction's own parameters as parameters of the model: `k` of reaction `R` is
/// `R_k`.
fn kinetic_law(sbml: &mut Sbml, node: Node<'_, '_>, reaction: &str) -> Result<Math, Fault> {
    let mut own: HashMap<String, String> = HashMap::new();
    for list in meaning(node).filter(|n| matches!(tag(*n), "listOfParameters" | "listOfLocalParameters")) {
        for item in meaning(list) {
            let mut local = parameter(item)?;
            let global = format!("{reaction}_{}", local.id);
            own.insert(local.id.clone(), local_id(reaction, &local.id));
            local.id = local_id(reaction, &local.id);
            local.constant = true;
            if local.name.is_empty() {
                local.name = format!("`{}` of {reaction}", global.trim_start_matches(&format!("{reaction}_")));
            }
            sbml.symbols.push(local);
        }
    }
    if let Some(other) = meaning(node).find(|n| !matches!(tag(*n), "math" | "listOfParameters" | "listOfLocalParameters")) {
        return Err(unknown(other, "kineticLaw"));
    }
    let renamed = math_needed(node)?.map(&mut |part| {
        Ok(match part {
            Math::Name(name) => Math::Name(own.get(&name).cloned().unwrap_or(name)),
            Math::RateOf(name) => Math::RateOf(own.get(&name).cloned().unwrap_or(name)),
            other => other,
        })
    });
    renamed.map_err(|why| fault(node, why))
}

/// The id of a reaction's own parameter: no id of the model has a dot.
fn local_id(reaction: &str, parameter: &str) -> String {
    format!("{reaction}.{parameter}")
}

/// An event; `None` for one without a trigger, which never happens.
fn event(node: Node<'_, '_>, number: usize) -> Result<Option<Event>, Fault> {
    let id = owned(node, "id").unwrap_or_else(|| format!("event_{}", number + 1));
    let mut assignments = vec![];
    for item in meaning(node) {
        match tag(item) {
            "trigger" | "delay" | "priority" => {}
            "listOfEventAssignments" => {
                for assignment in meaning(item) {
                    if let Some(math) = math_of(assignment)? {
                        assignments.push((assignment.range().start, needed(assignment, "variable")?, math));
                    }
                }
            }
            _ => return Err(unknown(item, "event")),
        }
    }
    let math = |name: &str| -> Result<Option<Math>, Fault> { only(node, name)?.map_or(Ok(None), math_of) };
    let (delay, priority) = (math("delay")?.filter(|delay| !matches!(delay, Math::Number(0.0, _))), math("priority")?);
    let (Some(condition), Some(trigger)) = (math("trigger")?, only(node, "trigger")?) else { return Ok(None) };
    Ok(Some(Event {
        at: node.range().start,
        id,
        name: owned(node, "name").unwrap_or_default(),
        trigger: condition,
        starts_true: flag(trigger, "initialValue", true)?,
        persistent: flag(trigger, "persistent", true)?,
        early_values: flag(node, "useValuesFromTriggerTime", true)?,
        delay,
        priority,
        assignments,
    }))
}

impl Sbml {
    /// The symbols of an expression, and those of the rules behind them.
    pub(super) fn through(&self, math: &Math) -> Vec<String> {
        let mut found: Vec<String> = vec![];
        let mut stack = math.names();
        while let Some(id) = stack.pop() {
            if found.contains(&id) {
                continue;
            }
            let rule = self.rules.iter().find(|r| matches!(&r.target, Target::Assignment(own) if *own == id));
            stack.extend(rule.map(|r| r.math.names()).unwrap_or_default());
            stack.extend(self.reactions.iter().find(|r| r.id == id).map(|r| r.rate.names()).unwrap_or_default());
            found.push(id);
        }
        found
    }
}
