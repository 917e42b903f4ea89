//! The flat document: elements of all models under the names that they have outside, with the
//! conversion factors of submodels and replacements in their expressions.

use std::fmt::Write as _;

use roxmltree::Node;

use super::super::known::MATHML;
use super::super::xml::attribute;
use super::{Flat, Hierarchy, Space};

/// Attributes that refer to a symbol, and to a unit.
const SYMBOLS: [&str; 6] = ["compartment", "species", "conversionFactor", "symbol", "variable", "outside"];
const UNITS: [&str; 7] = ["units", "substanceUnits", "timeUnits", "volumeUnits", "areaUnits", "lengthUnits", "extentUnits"];

/// Names that an expression finds before those of the model: bound variables, and parameters of a
/// kinetic law with their elements.
#[derive(Clone, Default)]
struct Scope {
    bound: Vec<String>,
    locals: Vec<(String, usize)>,
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn applied(operator: &str, first: &str, second: &str) -> String {
    format!("<apply><{operator}/>{first}{second}</apply>")
}

impl Hierarchy<'_, '_> {
    /// The document.
    pub(super) fn write(&self, root: Node<'_, '_>) -> Flat {
        let mut flat = Flat { xml: String::new(), origins: vec![] };
        let value = |name: &str| escaped(attribute(root, name).unwrap_or_default());
        let core = escaped(self.core.unwrap_or_default());
        _ = write!(flat.xml, "<sbml xmlns=\"{core}\" xmlns:sbml=\"{core}\" level=\"{}\" version=\"{}\"", value("level"), value("version"));
        for (number, namespace) in self.optional.iter().enumerate() {
            _ = write!(flat.xml, " xmlns:p{number}=\"{}\" p{number}:required=\"false\"", escaped(namespace));
        }
        flat.xml.push_str(">\n");
        self.open(&mut flat, self.instances[0].root, "model");
        let names: Vec<&str> = ["id", "name"].into_iter().chain(self.units_agree().then_some(UNITS).into_iter().flatten()).collect();
        for name in names {
            if let Some(value) = self.value(self.instances[0].root, name) {
                _ = write!(flat.xml, " {name}=\"{}\"", escaped(&self.unit_or(0, name, value)));
            }
        }
        flat.xml.push_str(">\n");
        for number in 0..self.instances.len() {
            for &list in &self.elements[self.instances[number].root].children {
                if self.elements[list].space == Space::Core && !self.elements[list].gone {
                    self.element(&mut flat, list);
                }
            }
        }
        flat.xml.push_str("</model>\n</sbml>\n");
        flat
    }

    /// Returns `true` if all models have the default units of the outermost one.
    fn units_agree(&self) -> bool {
        let of = |number: usize, name| self.value(self.instances[number].root, name);
        UNITS.iter().all(|name| (1..self.instances.len()).all(|number| of(number, name) == of(0, name)))
    }

    fn open(&self, flat: &mut Flat, e: usize, tag: &str) {
        flat.origins.push((flat.xml.len(), self.elements[e].at));
        _ = write!(flat.xml, "<{tag}");
    }

    /// An element of the core with all that it holds.
    fn element(&self, flat: &mut Flat, e: usize) {
        let element = &self.elements[e];
        if element.space == Space::Math {
            self.math(flat, e);
            return;
        }
        if element.space == Space::Comp || element.gone {
            return;
        }
        self.open(flat, e, &element.tag);
        for (name, value) in &element.attributes {
            let value = match name.as_str() {
                "metaid" | "sboTerm" => continue,
                "stoichiometry" if self.factor_of_species(e).is_some() => continue,
                "id" if element.tag == "localParameter" => self.local(e),
                "id" => self.name(e),
                name if SYMBOLS.contains(&name) => self.symbol(element.instance, value),
                name => self.unit_or(element.instance, name, value),
            };
            _ = write!(flat.xml, " {name}=\"{}\"", escaped(&value));
        }
        let of_model = self.value(self.instances[element.instance].root, "conversionFactor");
        if let Some(id) = of_model.filter(|_| element.tag == "species" && self.value(e, "conversionFactor").is_none()) {
            _ = write!(flat.xml, " conversionFactor=\"{}\"", escaped(&self.symbol(element.instance, id)));
        }
        flat.xml.push_str(">\n");
        if let Some(factor) = self.factor_of_species(e) {
            let number = self.value(e, "stoichiometry").unwrap_or("1");
            let product = applied("times", &format!("<cn>{}</cn>", escaped(number)), &factor);
            _ = writeln!(flat.xml, "<stoichiometryMath><math xmlns=\"{MATHML}\">{product}</math></stoichiometryMath>");
        }
        element.children.iter().for_each(|&child| self.element(flat, child));
        _ = writeln!(flat.xml, "</{}>", element.tag);
    }

    /// The factor by which a reaction of a submodel changes the species that replaces its own.
    fn factor_of_species(&self, e: usize) -> Option<String> {
        let element = &self.elements[e];
        let species = self.value(e, "species").filter(|_| element.tag == "speciesReference")?;
        self.factor(*self.instances[element.instance].ids.get(species)?)
    }

    /// Name of a symbol of a model in the flat document.
    fn symbol(&self, instance: usize, id: &str) -> String {
        self.instances[instance].ids.get(id).map_or_else(|| id.to_owned(), |&e| self.name(e))
    }

    /// Name of a unit, if the attribute refers to one; otherwise the value as it is.
    fn unit_or(&self, instance: usize, name: &str, value: &str) -> String {
        let unit = self.instances[instance].units.get(value).filter(|_| UNITS.contains(&name));
        unit.map_or_else(|| value.to_owned(), |&e| self.name(e))
    }

    /// Name of an element: that of the outermost element that it replaces, or is replaced by.
    fn name(&self, e: usize) -> String {
        let e = self.outermost(e);
        let prefix = &self.instances[self.elements[e].instance].prefix;
        self.value(e, "id").map_or_else(String::new, |id| format!("{prefix}{id}"))
    }

    /// Name of a parameter of a kinetic law.
    fn local(&self, e: usize) -> String {
        if self.elements[e].outside.is_some() { self.name(e) } else { self.value(e, "id").unwrap_or_default().to_owned() }
    }

    /// Product of the conversion factors between an element and the outermost one of its
    /// replacements.
    fn factor(&self, e: usize) -> Option<String> {
        let (mut e, mut product) = (e, None::<String>);
        while let Some((outside, factor)) = &self.elements[e].outside {
            if let Some(id) = factor {
                let own = self.value_of(self.elements[*outside].instance, id);
                product = Some(product.map_or_else(|| own.clone(), |all| applied("times", &all, &own)));
            }
            e = *outside;
        }
        product
    }

    /// Expression for the value of a symbol of a model.
    fn value_of(&self, instance: usize, id: &str) -> String {
        let Some(&e) = self.instances[instance].ids.get(id) else { return format!("<ci>{}</ci>", escaped(id)) };
        let mut value = format!("<ci>{}</ci>", escaped(&self.name(e)));
        if let Some(factor) = self.factor(e) {
            value = applied("divide", &value, &factor);
        }
        if self.elements[e].tag == "reaction" {
            let instance = self.outer(instance, self.elements[self.kept(self.outermost(e))].instance);
            value = self.converted(value, self.conversion(instance, "timeConversionFactor"), "times");
            value = self.converted(value, self.conversion(instance, "extentConversionFactor"), "divide");
        }
        value
    }

    /// That of two models, one inside the other, which is outside.
    fn outer(&self, a: usize, b: usize) -> usize {
        let depth = |instance: usize| self.instances[instance].prefix.len();
        if depth(a) <= depth(b) { a } else { b }
    }

    /// Returns `true` for a parameter of a kinetic law that its expression can name.
    fn is_local(&self, e: usize) -> bool {
        let element = &self.elements[e];
        element.tag == "localParameter" && (!element.gone || element.outside.is_some())
    }

    /// Product of a conversion factor of a submodel and of those around it.
    fn conversion(&self, instance: usize, name: &str) -> Option<String> {
        let submodel = self.instances[instance].submodel?;
        let around = self.elements[submodel].instance;
        let own = self.value(submodel, name).map(|id| self.value_of(around, id));
        match (own, self.conversion(around, name)) {
            (Some(own), Some(further)) => Some(applied("times", &own, &further)),
            (own, further) => own.or(further),
        }
    }

    fn converted(&self, value: String, factor: Option<String>, operator: &str) -> String {
        factor.map_or(value.clone(), |factor| applied(operator, &value, &factor))
    }

    /// An expression, converted to the units of the outermost model.
    fn math(&self, flat: &mut Flat, math: usize) {
        let instance = self.elements[math].instance;
        let holder = self.elements[math].holder;
        let mut scope = Scope::default();
        let tag = holder.map_or("", |e| self.elements[e].tag.as_str());
        if let Some(law) = holder.filter(|_| tag == "kineticLaw") {
            let locals = self.below(law).into_iter().filter(|&e| self.is_local(e));
            scope.locals = locals.filter_map(|e| Some((self.value(e, "id")?.to_owned(), e))).collect();
        }
        let mut value: String = self.elements[math].children.iter().map(|&child| self.expression(child, &scope)).collect();
        let (time, extent) = (self.conversion(instance, "timeConversionFactor"), self.conversion(instance, "extentConversionFactor"));
        let target = holder.and_then(|e| self.value(e, "variable").or_else(|| self.value(e, "symbol")));
        let of_target = target.and_then(|id| self.factor(*self.instances[instance].ids.get(id)?));
        value = self.converted(value, of_target, "times");
        value = match tag {
            "kineticLaw" => self.converted(self.converted(value, extent, "times"), time, "divide"),
            "rateRule" => self.converted(value, time, "divide"),
            "delay" => self.converted(value, time, "times"),
            _ => value,
        };
        self.open(flat, math, "math");
        _ = writeln!(flat.xml, " xmlns=\"{MATHML}\">{value}</math>");
    }

    /// A part of an expression.
    fn expression(&self, e: usize, scope: &Scope) -> String {
        let element = &self.elements[e];
        let text = element.text.trim();
        let time = || self.conversion(element.instance, "timeConversionFactor");
        match element.tag.as_str() {
            "ci" => self.reference(element.instance, text, scope),
            "csymbol" if self.is_symbol(e, "time") => self.converted(self.plain(e, scope), time(), "divide"),
            "apply" => self.call(e, scope),
            "lambda" => {
                let bound = element.children.iter().filter(|&&c| self.elements[c].tag == "bvar").flat_map(|&c| self.below(c));
                let names = bound.map(|c| self.elements[c].text.trim().to_owned()).filter(|name| !name.is_empty());
                let scope = Scope { bound: scope.bound.iter().cloned().chain(names).collect(), locals: scope.locals.clone() };
                self.plain(e, &scope)
            }
            _ => self.plain(e, scope),
        }
    }

    /// A name in an expression.
    fn reference(&self, instance: usize, name: &str, scope: &Scope) -> String {
        if scope.bound.iter().any(|bound| bound == name) {
            return format!("<ci>{}</ci>", escaped(name));
        }
        let Some((_, local)) = scope.locals.iter().find(|(own, _)| own == name) else { return self.value_of(instance, name) };
        let value = format!("<ci>{}</ci>", escaped(&self.local(*local)));
        self.converted(value, self.factor(*local), "divide")
    }

    /// A call: functions are named, dead times and rates converted.
    fn call(&self, e: usize, scope: &Scope) -> String {
        let element = &self.elements[e];
        let Some((&head, arguments)) = element.children.split_first() else { return self.plain(e, scope) };
        let time = self.conversion(element.instance, "timeConversionFactor");
        let mut parts: Vec<String> = arguments.iter().map(|&part| self.expression(part, scope)).collect();
        if self.elements[head].tag == "ci" {
            let name = self.symbol(element.instance, self.elements[head].text.trim());
            return format!("<apply><ci>{}</ci>{}</apply>", escaped(&name), parts.concat());
        }
        let head_text = self.plain(head, scope);
        if let Some(lag) = parts.get_mut(1).filter(|_| self.is_symbol(head, "delay")) {
            *lag = self.converted(std::mem::take(lag), time.clone(), "times");
        }
        if self.is_symbol(head, "rateOf") {
            let of = arguments.first().map(|&part| self.elements[part].text.trim()).unwrap_or_default();
            let found = self.instances[element.instance].ids.get(of).copied();
            let name = found.map_or_else(|| of.to_owned(), |e| self.name(e));
            let rate = format!("<apply>{head_text}<ci>{}</ci></apply>", escaped(&name));
            let rate = self.converted(rate, found.and_then(|e| self.factor(e)), "divide");
            return self.converted(rate, time, "times");
        }
        format!("<apply>{head_text}{}</apply>", parts.concat())
    }

    fn is_symbol(&self, e: usize, name: &str) -> bool {
        let url = self.value(e, "definitionURL").unwrap_or_default();
        self.elements[e].tag == "csymbol" && url.rsplit('/').next() == Some(name)
    }

    /// A part of an expression as it is, with its parts.
    fn plain(&self, e: usize, scope: &Scope) -> String {
        let element = &self.elements[e];
        let mut text = format!("<{}", element.tag);
        for (name, value) in &element.attributes {
            let prefix = if name == "units" { "sbml:" } else { "" };
            let value = self.unit_or(element.instance, name, value);
            _ = write!(text, " {prefix}{name}=\"{}\"", escaped(&value));
        }
        text.push('>');
        let parts: Vec<String> = element.children.iter().map(|&part| self.expression(part, scope)).collect();
        if element.tag == "cn" && !parts.is_empty() {
            // The parts of a number in two parts are around a separator.
            let mut words = element.text.split_whitespace().map(escaped);
            _ = write!(text, "{}{}{}", words.next().unwrap_or_default(), parts.concat(), words.next().unwrap_or_default());
        } else {
            text.push_str(&escaped(&element.text));
            parts.iter().for_each(|part| text.push_str(part));
        }
        _ = write!(text, "</{}>", element.tag);
        text
    }
}
