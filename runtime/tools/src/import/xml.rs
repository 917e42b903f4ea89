//! Elements of XML as SBML uses them, and faults at their places.

use roxmltree::Node;

/// Something in the file that cannot be carried over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) message: String,
}

pub(super) fn fault(node: Node<'_, '_>, message: impl Into<String>) -> Fault {
    Fault { at: node.range().start, message: message.into() }
}

/// The elements in an element.
pub(super) fn children<'a, 'i>(node: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(Node::is_element)
}

pub(super) fn tag<'a>(node: Node<'a, '_>) -> &'a str {
    node.tag_name().name()
}

pub(super) fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.attributes().find(|a| a.name() == name).map(|a| a.value())
}

/// A number as XML Schema writes one.
pub(super) fn number(node: Node<'_, '_>, text: &str) -> Result<f64, Fault> {
    match text.trim() {
        "INF" => Ok(f64::INFINITY),
        "-INF" => Ok(f64::NEG_INFINITY),
        "NaN" => Ok(f64::NAN),
        text if !text.contains(|c: char| c.is_alphabetic() && c != 'e' && c != 'E') => {
            text.parse().map_err(|_| fault(node, format!("`{text}` is not a number")))
        }
        text => Err(fault(node, format!("`{text}` is not a number"))),
    }
}
