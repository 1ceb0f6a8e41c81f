//! Python pickles as inert data.
//!
//! A pickle is a program for a stack machine that may import and call anything. Here nothing is imported or called:
//! names, calls and object states become [`Value`]s that describe what the program would have done. Readers of the
//! graph interpret the few values that they need.
//!
//! Values are stored in one array and refer to each other by index. So sharing costs nothing (a pickle of a few bytes
//! can describe a tree of 2⁶⁰ leaves), and nothing here recurses, not even the destructor.

mod machine;
mod opcode;

pub(super) use machine::parse;

/// Index of a value in its [`Graph`].
pub(super) type Id = u32;

/// A value in a pickle. Strings borrow from the pickle's bytes.
#[derive(Debug)]
pub(super) enum Value<'a> {
    None,
    Bool(bool),
    Int(i64),
    /// An integer beyond 64 bits.
    BigInt,
    Float(f64),
    Text(&'a str),
    Bytes,
    /// A class or function by name.
    Global {
        module: &'a str,
        name: &'a str,
    },
    Tuple(Vec<Id>),
    List(Vec<Id>),
    Set(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// A reference to something outside the pickle, here a storage.
    Persistent(Id),
    Object(Box<Object>),
}

/// The object that a call or an instantiation would have created.
#[derive(Debug)]
pub(super) struct Object {
    /// The class or function.
    pub callable: Id,
    /// The arguments, usually a tuple.
    pub arguments: Id,
    /// The attributes set afterwards, usually a dict.
    pub state: Option<Id>,
    /// Entries set afterwards, if the object is a kind of dict.
    pub entries: Vec<(Id, Id)>,
}

/// All values of a pickle.
#[derive(Debug)]
pub(super) struct Graph<'a> {
    values: Vec<Value<'a>>,
    root: Id,
}

/// The pickle is damaged or uses features that no checkpoint uses.
#[derive(Debug)]
pub(super) struct PickleError {
    /// Byte at which the error was detected.
    pub offset: usize,
    pub found: String,
    pub expected: &'static str,
}

impl<'a> Graph<'a> {
    /// The pickled value.
    pub fn root(&self) -> Id {
        self.root
    }

    /// All values that the pickle creates, including those that are not part of the result.
    pub fn values(&self) -> &[Value<'a>] {
        &self.values
    }

    pub fn value(&self, id: Id) -> &Value<'a> {
        // Ids always come from this graph: the machine creates an id only after its value.
        &self.values[id as usize]
    }

    pub fn text(&self, id: Id) -> Option<&'a str> {
        match self.value(id) {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A non-negative integer.
    pub fn size(&self, id: Id) -> Option<usize> {
        match self.value(id) {
            Value::Int(value) => usize::try_from(*value).ok(),
            _ => None,
        }
    }

    pub fn tuple(&self, id: Id) -> Option<&[Id]> {
        match self.value(id) {
            Value::Tuple(items) => Some(items),
            _ => None,
        }
    }

    pub fn object(&self, id: Id) -> Option<&Object> {
        match self.value(id) {
            Value::Object(object) => Some(object),
            _ => None,
        }
    }

    /// Module and name of an object's class or function.
    pub fn callable(&self, object: &Object) -> Option<(&'a str, &'a str)> {
        match self.value(object.callable) {
            Value::Global { module, name } => Some((module, name)),
            _ => None,
        }
    }

    /// Entries of a dict or an `OrderedDict`, in the order in which they were set.
    pub fn entries(&self, id: Id) -> Option<&[(Id, Id)]> {
        match self.value(id) {
            Value::Dict(entries) => Some(entries),
            Value::Object(object) if self.callable(object) == Some(("collections", "OrderedDict")) => {
                Some(&object.entries)
            }
            _ => None,
        }
    }

    /// Describes a value, for messages.
    pub fn describe(&self, id: Id) -> String {
        match self.value(id) {
            Value::None => "None".to_owned(),
            Value::Bool(_) => "a bool".to_owned(),
            Value::Int(_) | Value::BigInt => "an integer".to_owned(),
            Value::Float(_) => "a float".to_owned(),
            Value::Text(_) => "a string".to_owned(),
            Value::Bytes => "bytes".to_owned(),
            Value::Tuple(_) => "a tuple".to_owned(),
            Value::List(_) => "a list".to_owned(),
            Value::Set(_) => "a set".to_owned(),
            Value::Dict(_) => "a dict".to_owned(),
            Value::Persistent(_) => "a storage".to_owned(),
            Value::Global { module, name } => format!("the name {module}.{name}"),
            Value::Object(object) => match self.callable(object) {
                Some((module, name)) => format!("an object made by {module}.{name}"),
                None => "an object of unknown type".to_owned(),
            },
        }
    }
}
