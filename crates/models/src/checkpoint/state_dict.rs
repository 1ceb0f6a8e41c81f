//! The state dict described by a pickle: names, shapes and storages of tensors.
//!
//! Ultralytics saves whole modules. Their tensors are collected like `torch.nn.Module.state_dict` does: parameters,
//! then persistent buffers, then child modules, each in registration order, with names joined by dots. Module classes
//! are ignored, so checkpoints of all versions of Ultralytics are read alike, whatever their module paths.

use super::configuration;
use super::error::Fault;
use super::pickle::{Graph, Id, Value};
use super::stored_tensor::{self, StoredTensor};
use serde_json::Value as Json;
use std::collections::HashSet;

/// Maximum number of dict entries visited; the largest checkpoints have a hundredth of it. Shared dicts count on every
/// visit: a small pickle can describe a tree of any size.
const MAX_STEPS: usize = 1 << 22;
/// Maximum nesting depth of modules; the networks read here have five levels.
const MAX_DEPTH: usize = 64;
/// Maximum number of tensors; SAM 2.1 large has 903.
const MAX_TENSORS: usize = 1 << 16;
/// Maximum length of a tensor's name, bytes.
const MAX_NAME: usize = 512;

/// A state dict whose tensors have not been located in the archive yet.
#[derive(Debug, Default)]
pub(super) struct StateDict<'a> {
    pub tensors: Vec<StoredTensor<'a>>,
    /// The module's own configuration (`yaml`), if the file contains a module.
    pub configuration: Option<Json>,
    /// The ε of its batch norms.
    pub batch_norm_eps: Option<f64>,
    /// Class of the module, if the file contains one.
    pub class: Option<String>,
}

/// Reads the tensors of a pickled module or state dict, or of a training state that contains one as `ema` (preferred)
/// or `model`.
pub(super) fn read<'a>(graph: &Graph<'a>) -> Result<StateDict<'a>, Fault> {
    let mut reader = Reader { graph, steps: 0, names: HashSet::new(), found: StateDict::default() };
    let root = reader.weights_root(graph.root())?;
    if let Some(state) = reader.module_state(root)? {
        reader.found.class = graph.object(root).and_then(|object| graph.callable(object)).map(|(_, name)| name.into());
        reader.found.configuration = match reader.attribute(state, "yaml")? {
            Some(yaml) => configuration::json(graph, yaml)?,
            None => None,
        };
        reader.module(root, "", 0)?;
    } else if let Some(entries) = graph.entries(root) {
        for &(key, value) in entries {
            reader.step(1)?;
            // The dict may also contain numbers, strings and other dicts.
            let is_object = graph.object(value).is_some() && graph.entries(value).is_none();
            if let Some(name) = graph.text(key).filter(|_| is_object) {
                reader.tensor("", name, value)?;
            }
        }
    } else {
        return Err(Fault::part("the pickle", graph.describe(root), "a module or a state dict"));
    }
    if reader.found.tensors.is_empty() {
        return Err(Fault::part("the pickle", "no tensor", "a module or a state dict, alone or as `model` or `ema`"));
    }
    Ok(reader.found)
}

struct Reader<'g, 'a> {
    graph: &'g Graph<'a>,
    steps: usize,
    names: HashSet<String>,
    found: StateDict<'a>,
}

impl<'g, 'a> Reader<'g, 'a> {
    fn step(&mut self, steps: usize) -> Result<(), Fault> {
        self.steps += steps;
        if self.steps > MAX_STEPS {
            return Err(Fault::part("the pickle", "more entries than any network has", format!("at most {MAX_STEPS}")));
        }
        Ok(())
    }

    /// Value of the entry `name`; the last one if there are several.
    fn attribute(&mut self, table: Id, name: &str) -> Result<Option<Id>, Fault> {
        let graph = self.graph;
        let Some(entries) = graph.entries(table) else { return Ok(None) };
        self.step(entries.len())?;
        Ok(entries.iter().rev().find(|(key, _)| graph.text(*key) == Some(name)).map(|(_, value)| *value))
    }

    /// Finds the value that contains the weights.
    fn weights_root(&mut self, root: Id) -> Result<Id, Fault> {
        for name in ["ema", "model"] {
            if let Some(value) = self.attribute(root, name)? {
                let holds_weights = self.graph.entries(value).is_some() || self.module_state(value)?.is_some();
                if holds_weights {
                    return Ok(value);
                }
            }
        }
        Ok(root)
    }

    /// The attributes of an object, if it is a module.
    fn module_state(&mut self, id: Id) -> Result<Option<Id>, Fault> {
        let Some(state) = self.graph.object(id).and_then(|object| object.state) else { return Ok(None) };
        Ok(self.attribute(state, "_modules")?.map(|_| state))
    }

    fn table(&mut self, state: Id, name: &'static str, prefix: &str) -> Result<&'g [(Id, Id)], Fault> {
        let graph = self.graph;
        let fault = |found: String| Fault::part(format!("module {prefix:?}"), found, format!("a dict {name}"));
        let table = self.attribute(state, name)?.ok_or_else(|| fault("no such attribute".to_owned()))?;
        let entries = graph.entries(table).ok_or_else(|| fault(graph.describe(table)))?;
        self.step(entries.len())?;
        Ok(entries)
    }

    /// Collects the tensors of a module and its child modules.
    fn module(&mut self, id: Id, prefix: &str, depth: usize) -> Result<(), Fault> {
        let graph = self.graph;
        if depth > MAX_DEPTH {
            let found = format!("modules nested {depth} deep");
            return Err(Fault::part("the pickle", found, format!("at most {MAX_DEPTH}")));
        }
        let state = self.module_state(id)?;
        let state = state.ok_or_else(|| {
            Fault::part(format!("module {prefix:?}"), graph.describe(id), "a module with its attributes")
        })?;
        self.batch_norm(id, state, prefix)?;
        for (key, value) in self.table(state, "_parameters", prefix)? {
            self.parameter_or_buffer(prefix, *key, *value)?;
        }
        let transient = self.transient_buffers(state)?;
        for (key, value) in self.table(state, "_buffers", prefix)? {
            if !graph.text(*key).is_some_and(|name| transient.contains(name)) {
                self.parameter_or_buffer(prefix, *key, *value)?;
            }
        }
        for (key, child) in self.table(state, "_modules", prefix)? {
            let name = graph.text(*key).ok_or_else(|| {
                Fault::part(format!("module {prefix:?}"), graph.describe(*key), "a string as a child module's name")
            })?;
            if !matches!(graph.value(*child), Value::None) {
                self.module(*child, &qualified_name(prefix, name)?, depth + 1)?;
            }
        }
        Ok(())
    }

    /// Adds a parameter or buffer. Its value may be `None` (a convolution without bias).
    fn parameter_or_buffer(&mut self, prefix: &str, key: Id, value: Id) -> Result<(), Fault> {
        let name = self.graph.text(key).ok_or_else(|| {
            Fault::part(format!("module {prefix:?}"), self.graph.describe(key), "a string as a tensor's name")
        })?;
        match self.graph.value(value) {
            Value::None => Ok(()),
            _ => self.tensor(prefix, name, value),
        }
    }

    /// Names of the buffers that are not part of the state dict.
    fn transient_buffers(&mut self, state: Id) -> Result<HashSet<&'a str>, Fault> {
        let graph = self.graph;
        let Some(set) = self.attribute(state, "_non_persistent_buffers_set")? else { return Ok(HashSet::new()) };
        let items = match graph.value(set) {
            Value::Set(items) => Some(items),
            // Protocol 2 has no sets: it calls `set` with a list.
            Value::Object(object) => match graph.tuple(object.arguments) {
                Some(&[list]) => match graph.value(list) {
                    Value::List(items) => Some(items),
                    _ => None,
                },
                _ => None,
            },
            _ => None,
        };
        let items = items.map_or(&[][..], Vec::as_slice);
        self.step(items.len())?;
        Ok(items.iter().filter_map(|&item| graph.text(item)).collect())
    }

    fn batch_norm(&mut self, id: Id, state: Id, prefix: &str) -> Result<(), Fault> {
        let graph = self.graph;
        let class = graph.object(id).and_then(|object| graph.callable(object));
        if class.is_none_or(|(_, name)| name != "BatchNorm2d") {
            return Ok(());
        }
        let Some(Value::Float(eps)) = self.attribute(state, "eps")?.map(|eps| graph.value(eps)) else { return Ok(()) };
        let first = *self.found.batch_norm_eps.get_or_insert(*eps);
        if first.to_bits() == eps.to_bits() {
            return Ok(());
        }
        Err(Fault::part(format!("module {prefix:?}"), format!("eps {eps}"), format!("{first} as in the others")))
    }

    fn tensor(&mut self, prefix: &str, name: &str, value: Id) -> Result<(), Fault> {
        let name = qualified_name(prefix, name)?;
        if !self.names.insert(name.clone()) {
            return Err(Fault::tensor(&name, "the name twice", "unique names"));
        }
        if self.names.len() > MAX_TENSORS {
            return Err(Fault::part(
                "the pickle",
                "more tensors than any network has",
                format!("at most {MAX_TENSORS}"),
            ));
        }
        let tensor = stored_tensor::read(self.graph, name, value)?;
        self.found.tensors.push(tensor);
        Ok(())
    }
}

/// Qualifies a name with the module `prefix`.
fn qualified_name(prefix: &str, name: &str) -> Result<String, Fault> {
    if prefix.len() + name.len() >= MAX_NAME {
        let found = format!("a name of {} bytes", prefix.len() + name.len() + 1);
        return Err(Fault::tensor(&format!("{prefix}.{name}"), found, format!("at most {MAX_NAME}")));
    }
    Ok(if prefix.is_empty() { name.to_owned() } else { format!("{prefix}.{name}") })
}
