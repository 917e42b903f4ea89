//! Hierarchical models of the package `comp`, turned into one model of the core.
//!
//! Each submodel is a copy of its definition. Deletions and replacements are carried out from the
//! innermost submodels outwards. A replaced element is removed, and all references to it are to
//! what replaces it, divided by the conversion factor. The result is written as a document of the
//! core (`emit`), with the place of each element in the file.

mod emit;

use std::collections::{BTreeMap, HashMap};

use roxmltree::{Document, Node};

use super::known::{self, MATHML};
use super::xml::{Fault, attribute, children, fault, tag};

/// Most elements of all copies, and most submodels inside one another.
const MOST_ELEMENTS: usize = 1_000_000;
const DEEPEST: usize = 32;

/// A document of the core, with the places of its elements in the file.
pub(super) struct Flat {
    pub(super) xml: String,
    /// Offsets in the document and in the file.
    origins: Vec<(usize, usize)>,
}

impl Flat {
    /// Place in the file of a place in the document.
    pub(super) fn origin(&self, at: usize) -> usize {
        let behind = self.origins.partition_point(|&(offset, _)| offset <= at);
        self.origins.get(behind.saturating_sub(1)).map_or(0, |&(_, origin)| origin)
    }
}

/// Vocabulary of an element.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Space {
    Core,
    Math,
    Comp,
}

/// A copy of an element.
struct Copied {
    at: usize,
    tag: String,
    space: Space,
    attributes: Vec<(String, String)>,
    text: String,
    /// The element around it.
    holder: Option<usize>,
    children: Vec<usize>,
    instance: usize,
    gone: bool,
    /// The element outside that has its name, and the id of the conversion factor in the model
    /// of that element.
    outside: Option<(usize, Option<String>)>,
    /// The element inside that replaces it.
    inside: Option<usize>,
}

/// A model with its submodels: the outermost one, or a copy of a definition.
#[derive(Default)]
struct Instance {
    root: usize,
    prefix: String,
    /// The element of this submodel in the model around it.
    submodel: Option<usize>,
    ids: HashMap<String, usize>,
    metas: HashMap<String, usize>,
    units: HashMap<String, usize>,
    ports: HashMap<String, usize>,
    deleted: HashMap<String, usize>,
    subs: BTreeMap<String, usize>,
}

struct Hierarchy<'d, 'i> {
    core: Option<&'d str>,
    comp: &'d str,
    optional: Vec<&'d str>,
    definitions: HashMap<&'d str, Node<'d, 'i>>,
    /// Begins all ids of copies, with more underscores than any id has in a row.
    joint: String,
    elements: Vec<Copied>,
    instances: Vec<Instance>,
}

/// The document without its hierarchy; `None` for one that does not use the package.
///
/// # Errors
/// A reference to nothing, a definition in another file, and what the package does not define.
pub(super) fn flatten(document: &Document<'_>) -> Result<Option<Flat>, Fault> {
    let root = document.root_element();
    let packages = || root.attributes().filter(|a| a.name() == "required").filter_map(|a| Some((a.namespace()?, a.value())));
    let Some((comp, _)) = packages().find(|(namespace, _)| known::package(namespace) == "comp") else { return Ok(None) };
    let others: Vec<_> = packages().filter(|(namespace, _)| *namespace != comp).collect();
    if others.iter().any(|(_, required)| !matches!(*required, "false" | "0")) {
        return Ok(None);
    }
    let core = root.tag_name().namespace();
    let mut definitions = HashMap::new();
    for definition in root.descendants().filter(|n| n.tag_name().namespace() == Some(comp)) {
        match tag(definition) {
            "externalModelDefinition" => {
                return Err(fault(definition, "a model definition in another file is not read: put it into this file"));
            }
            "modelDefinition" => drop(definitions.insert(attribute(definition, "id").unwrap_or_default(), definition)),
            _ => {}
        }
    }
    let Some(model) = children(root).find(|n| tag(*n) == "model" && n.tag_name().namespace() == core) else { return Ok(None) };
    if let Some(id) = attribute(model, "id") {
        definitions.entry(id).or_insert(model);
    }
    let optional = others.iter().map(|(namespace, _)| *namespace).collect();
    let mut hierarchy = Hierarchy { core, comp, optional, definitions, joint: joint(root), elements: vec![], instances: vec![] };
    hierarchy.instantiate(model, String::new(), None, 0)?;
    Ok(Some(hierarchy.write(root)))
}

/// Underscores, more than any id has in a row.
fn joint(root: Node<'_, '_>) -> String {
    let ids = root.descendants().filter(Node::is_element).filter_map(|n| attribute(n, "id"));
    let longest = ids.flat_map(|id| id.split(|c| c != '_').map(str::len)).max().unwrap_or(0);
    "_".repeat(longest.max(1) + 1)
}

impl<'d, 'i> Hierarchy<'d, 'i> {
    /// Copies a definition with its submodels, and carries out what it deletes and replaces.
    fn instantiate(&mut self, definition: Node<'d, 'i>, prefix: String, submodel: Option<usize>, depth: usize) -> Result<usize, Fault> {
        if depth > DEEPEST {
            return Err(fault(definition, "submodels contain one another without end"));
        }
        let number = self.instances.len();
        self.instances.push(Instance { prefix, submodel, ..Instance::default() });
        let root = self.copy(definition, number, None)?;
        self.instances[number].root = root;
        let submodels: Vec<usize> = self.below(root).into_iter().filter(|&e| self.is(e, "submodel")).collect();
        for &e in &submodels {
            let (id, model) = (self.needed(e, "id")?.to_owned(), self.needed(e, "modelRef")?);
            let definition = *self.definitions.get(model).ok_or_else(|| self.fault(e, format!("unknown model definition `{model}`")))?;
            let prefix = format!("{}{id}{}", self.instances[number].prefix, self.joint);
            let made = self.instantiate(definition, prefix, Some(e), depth + 1)?;
            self.instances[number].subs.insert(id, made);
        }
        for &e in &submodels {
            self.delete(number, e)?;
        }
        for e in self.below(root) {
            if self.elements[e].space == Space::Core && !self.elements[e].gone {
                self.replace(number, e)?;
            }
        }
        Ok(number)
    }

    /// Copies an element with all that it holds, but notes, annotations, and optional packages.
    fn copy(&mut self, node: Node<'d, 'i>, instance: usize, holder: Option<usize>) -> Result<usize, Fault> {
        let space = match node.tag_name().namespace() {
            namespace if namespace == self.core || tag(node) == "modelDefinition" => Space::Core,
            Some(MATHML) => Space::Math,
            Some(namespace) if namespace == self.comp => Space::Comp,
            _ => return Err(fault(node, format!("`{}` of a package that is not declared with `required=\"false\"`", tag(node)))),
        };
        let number = self.elements.len();
        if number >= MOST_ELEMENTS {
            return Err(fault(node, format!("more than {MOST_ELEMENTS} elements in all submodels")));
        }
        let attributes = node.attributes().map(|a| (a.name().to_owned(), a.value().to_owned())).collect();
        let text: String = node.children().filter(Node::is_text).filter_map(|n| n.text()).collect();
        let (at, tag_) = (node.range().start, tag(node).to_owned());
        let element =
            Copied { at, tag: tag_, space, attributes, text, holder, children: vec![], instance, gone: false, outside: None, inside: None };
        self.elements.push(element);
        self.index(number);
        for child in children(node) {
            let optional = child.tag_name().namespace().is_some_and(|namespace| self.optional.contains(&namespace));
            if optional || matches!(tag(child), "notes" | "annotation" | "annotation-xml" | "message") {
                continue;
            }
            let made = self.copy(child, instance, Some(number))?;
            self.elements[number].children.push(made);
        }
        Ok(number)
    }

    /// Notes the ids of a new element.
    fn index(&mut self, number: usize) {
        let element = &self.elements[number];
        let instance = &mut self.instances[element.instance];
        let value = |name: &str| element.attributes.iter().find(|(own, _)| own == name).map(|(_, value)| value.clone());
        instance.metas.extend(value("metaid").map(|id| (id, number)));
        let ids = match (element.space, element.tag.as_str()) {
            (Space::Comp, "port") => &mut instance.ports,
            (Space::Comp, "submodel") => &mut instance.ids,
            (Space::Core, "unitDefinition") => &mut instance.units,
            (Space::Comp | Space::Math, _) | (_, "localParameter" | "modelDefinition" | "model") => return,
            _ => &mut instance.ids,
        };
        ids.extend(value("id").map(|id| (id, number)));
    }

    /// Deletes what a submodel lists.
    fn delete(&mut self, number: usize, submodel: usize) -> Result<(), Fault> {
        let sub = self.instances[number].subs[self.needed(submodel, "id")?];
        let deletions: Vec<usize> = self.below(submodel).into_iter().filter(|&e| self.is(e, "deletion")).collect();
        for e in deletions {
            let target = self.find(sub, e)?;
            self.remove(self.kept(target));
            if let Some(id) = self.value(e, "id").map(str::to_owned) {
                self.instances[sub].deleted.insert(id, target);
            }
        }
        Ok(())
    }

    /// Carries out the replacements that an element lists.
    fn replace(&mut self, number: usize, e: usize) -> Result<(), Fault> {
        let own: Vec<usize> = self.elements[e].children.iter().copied().filter(|&c| self.elements[c].space == Space::Comp).collect();
        for list in own {
            match self.elements[list].tag.as_str() {
                "listOfReplacedElements" => {
                    for part in self.elements[list].children.clone() {
                        let sub = self.sub_of(number, part)?;
                        if let Some(id) = self.value(part, "deletion") {
                            let known = self.instances[sub].deleted.contains_key(id);
                            known.then_some(()).ok_or_else(|| self.fault(part, format!("unknown deletion `{id}`")))?;
                            continue;
                        }
                        let target = self.find(sub, part)?;
                        self.remove(self.kept(self.outermost(target)));
                        let factor = self.value(part, "conversionFactor").map(str::to_owned);
                        self.link(part, target, (e, factor))?;
                    }
                }
                "replacedBy" => {
                    let sub = self.sub_of(number, list)?;
                    let target = self.find(sub, list)?;
                    if self.elements[e].tag == "localParameter" {
                        return Err(self.fault(e, "a local parameter that a submodel replaces has no counterpart"));
                    }
                    self.elements[e].gone = true;
                    self.elements[e].inside = Some(self.outermost(target));
                    self.link(list, target, (e, None))?;
                }
                "listOfSubmodels" | "listOfPorts" => {}
                other => return Err(self.fault(list, format!("`{other}` of the package `comp` is not known"))),
            }
        }
        Ok(())
    }

    /// Gives an element, with all that it replaces, the name of one of the model around it.
    fn link(&mut self, place: usize, target: usize, outside: (usize, Option<String>)) -> Result<(), Fault> {
        let last = self.outermost(target);
        let converts = last != target && (outside.1.is_some() || self.elements[target].outside.as_ref().is_some_and(|(_, f)| f.is_some()));
        if converts || self.elements[last].instance == self.elements[outside.0].instance {
            return Err(self.fault(place, "an element is replaced twice"));
        }
        self.elements[last].outside = Some(outside);
        Ok(())
    }

    /// The element of the outermost model whose name an element has.
    fn outermost(&self, e: usize) -> usize {
        let mut e = e;
        while let Some((outside, _)) = &self.elements[e].outside {
            e = *outside;
        }
        e
    }

    /// The submodel that a replacement refers to.
    fn sub_of(&self, number: usize, e: usize) -> Result<usize, Fault> {
        let id = self.needed(e, "submodelRef")?;
        self.instances[number].subs.get(id).copied().ok_or_else(|| self.fault(e, format!("unknown submodel `{id}`")))
    }

    /// The element that a reference into a model means.
    fn find(&self, number: usize, e: usize) -> Result<usize, Fault> {
        let instance = &self.instances[number];
        let by = [("idRef", &instance.ids), ("metaIdRef", &instance.metas), ("unitRef", &instance.units), ("portRef", &instance.ports)];
        let mut named = by.iter().filter_map(|(name, all)| Some((*name, self.value(e, name)?, all)));
        let (name, id, all) = named.next().ok_or_else(|| self.fault(e, format!("`{}` without a reference", self.elements[e].tag)))?;
        let found = *all.get(id).ok_or_else(|| self.fault(e, format!("unknown `{name}` `{id}`")))?;
        let of_port = name == "portRef";
        if of_port && self.value(found, "portRef").is_some() {
            return Err(self.fault(found, "a port that refers to a port"));
        }
        let found = if of_port { self.find(number, found)? } else { found };
        let Some(&inner) = self.elements[e].children.iter().find(|&&c| self.is(c, "sBaseRef")) else { return Ok(found) };
        let sub = self.value(found, "id").and_then(|id| self.instances[self.elements[found].instance].subs.get(id));
        self.find(*sub.ok_or_else(|| self.fault(e, format!("`{id}` is not a submodel")))?, inner)
    }

    /// The element that is used for one: itself, or what replaces it from inside.
    fn kept(&self, e: usize) -> usize {
        let mut e = e;
        while let Some(inside) = self.elements[e].inside {
            e = inside;
        }
        e
    }

    /// Removes an element with all that it holds; a submodel with its copy.
    fn remove(&mut self, e: usize) {
        for part in self.below(e) {
            self.elements[part].gone = true;
        }
        let inside = self.value(e, "id").filter(|_| self.is(e, "submodel"));
        let Some(&sub) = inside.and_then(|id| self.instances[self.elements[e].instance].subs.get(id)) else { return };
        let submodels: Vec<usize> = self.below(self.instances[sub].root).into_iter().filter(|&e| self.is(e, "submodel")).collect();
        self.remove(self.instances[sub].root);
        submodels.into_iter().for_each(|e| self.remove(e));
    }

    /// An element and all that it holds.
    fn below(&self, e: usize) -> Vec<usize> {
        let mut all = vec![e];
        let mut next = 0;
        while next < all.len() {
            all.extend(&self.elements[all[next]].children);
            next += 1;
        }
        all
    }

    /// Returns `true` if an element of the package has this tag.
    fn is(&self, e: usize, tag: &str) -> bool {
        self.elements[e].space == Space::Comp && self.elements[e].tag == tag
    }

    fn value(&self, e: usize, name: &str) -> Option<&str> {
        self.elements[e].attributes.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    fn needed(&self, e: usize, name: &str) -> Result<&str, Fault> {
        self.value(e, name).ok_or_else(|| self.fault(e, format!("`{}` without `{name}`", self.elements[e].tag)))
    }

    fn fault(&self, e: usize, message: impl Into<String>) -> Fault {
        Fault { at: self.elements[e].at, message: message.into() }
    }
}
