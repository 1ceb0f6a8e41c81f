//! Parameters: what the session was started with, to be read, and `use_sim_time`, to be set.

use crate::Ros2Error;
use crate::endpoints::Endpoints;
use crate::service::{Answer, Service};
use crate::sim_time::SimTime;
use serde::{Deserialize, Serialize};
use splatseg_ros::{from_cdr, to_cdr};
use std::collections::BTreeMap;
use std::sync::Arc;

const USE_SIM_TIME: &str = "use_sim_time";

/// A parameter's value.
#[derive(Clone, Debug, PartialEq)]
pub enum ParameterValue {
    /// True or false.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Double(f64),
    /// A text.
    String(String),
}

/// `rcl_interfaces/msg/ParameterValue`.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Value {
    r#type: u8,
    bool_value: bool,
    integer_value: i64,
    double_value: f64,
    string_value: String,
    byte_array_value: Vec<u8>,
    bool_array_value: Vec<bool>,
    integer_array_value: Vec<i64>,
    double_array_value: Vec<f64>,
    string_array_value: Vec<String>,
}

/// `rcl_interfaces/msg/ParameterType`; 0 means not set.
const BOOL: u8 = 1;
const INTEGER: u8 = 2;
const DOUBLE: u8 = 3;
const STRING: u8 = 4;

impl From<&ParameterValue> for Value {
    fn from(value: &ParameterValue) -> Self {
        match value {
            ParameterValue::Bool(value) => Self { r#type: BOOL, bool_value: *value, ..Self::default() },
            ParameterValue::Integer(value) => Self { r#type: INTEGER, integer_value: *value, ..Self::default() },
            ParameterValue::Double(value) => Self { r#type: DOUBLE, double_value: *value, ..Self::default() },
            ParameterValue::String(value) => Self { r#type: STRING, string_value: value.clone(), ..Self::default() },
        }
    }
}

/// A request with names: `GetParameters`, `GetParameterTypes`, `DescribeParameters`.
#[derive(Deserialize)]
struct Names {
    names: Vec<String>,
}

/// The request of `ListParameters`.
#[derive(Deserialize)]
struct Listed {
    prefixes: Vec<String>,
    depth: u64,
}

/// `rcl_interfaces/msg/Parameter`.
#[derive(Deserialize)]
struct Parameter {
    name: String,
    value: Value,
}

/// The request of `SetParameters` and `SetParametersAtomically`.
#[derive(Deserialize)]
struct NewValues {
    parameters: Vec<Parameter>,
}

/// `rcl_interfaces/msg/SetParametersResult`.
#[derive(Serialize)]
struct SetResult {
    successful: bool,
    reason: String,
}

/// `rcl_interfaces/msg/ParameterDescriptor`. The ranges are always empty.
#[derive(Serialize)]
struct Descriptor {
    name: String,
    r#type: u8,
    description: String,
    additional_constraints: String,
    read_only: bool,
    dynamic_typing: bool,
    floating_point_range: Vec<[f64; 3]>,
    integer_range: Vec<[u64; 3]>,
}

/// The node's parameters.
pub(crate) struct Parameters {
    fixed: BTreeMap<String, ParameterValue>,
    sim_time: SimTime,
}

impl Parameters {
    pub(crate) fn new(fixed: BTreeMap<String, ParameterValue>, sim_time: SimTime) -> Self {
        Self { fixed, sim_time }
    }

    fn get(&self, name: &str) -> Value {
        match name {
            USE_SIM_TIME => Value::from(&ParameterValue::Bool(self.sim_time.is_used())),
            name => self.fixed.get(name).map(Value::from).unwrap_or_default(),
        }
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        self.fixed.keys().map(String::as_str).chain([USE_SIM_TIME])
    }

    /// Names as `rclcpp` lists them: all, or those with a prefix, with at most `depth` parts after it (0: any number).
    fn list(&self, request: &Listed) -> [Vec<String>; 2] {
        let depth = usize::try_from(request.depth).unwrap_or(usize::MAX);
        let fits = |rest: &str| depth == 0 || rest.split('.').count() <= depth;
        let is_listed = |name: &&str| {
            let mut prefixes = request.prefixes.iter();
            let rest = |prefix: &String| name.strip_prefix(prefix.as_str()).and_then(|rest| rest.strip_prefix('.'));
            (request.prefixes.is_empty() && fits(name))
                || prefixes.any(|prefix| *name == prefix || rest(prefix).is_some_and(fits))
        };
        let names: Vec<String> = self.names().filter(is_listed).map(str::to_owned).collect();
        let mut prefixes: Vec<String> =
            names.iter().filter_map(|name| name.rsplit_once('.')).map(|(prefix, _)| prefix.to_owned()).collect();
        prefixes.sort_unstable();
        prefixes.dedup();
        [names, prefixes]
    }

    /// Why a parameter cannot be set.
    fn refusal(&self, parameter: &Parameter) -> Option<String> {
        match (parameter.name.as_str(), parameter.value.r#type) {
            (USE_SIM_TIME, BOOL) => None,
            (USE_SIM_TIME, _) => Some("use_sim_time: expected true or false".to_owned()),
            (name, _) if self.fixed.contains_key(name) => {
                Some(format!("{name}: read only; it is an option of splatseg ros2"))
            }
            (name, _) => Some(format!("{name}: no such parameter")),
        }
    }

    fn set(&self, parameter: &Parameter) -> SetResult {
        let reason = self.refusal(parameter);
        if reason.is_none() {
            self.sim_time.set_used(parameter.value.bool_value);
        }
        SetResult { successful: reason.is_none(), reason: reason.unwrap_or_default() }
    }

    fn describe(&self, name: String) -> Descriptor {
        let r#type = self.get(&name).r#type;
        let read_only = name != USE_SIM_TIME;
        let [description, additional_constraints] = [String::new(), String::new()];
        let (floating_point_range, integer_range) = (Vec::new(), Vec::new());
        Descriptor {
            name,
            r#type,
            description,
            additional_constraints,
            read_only,
            dynamic_typing: false,
            floating_point_range,
            integer_range,
        }
    }
}

/// Offers the six services of the parameters of a node with a full name.
pub(crate) fn services(endpoints: &Endpoints, node: &str, parameters: Parameters) -> Result<Vec<Service>, Ros2Error> {
    let all = Arc::new(parameters);
    let service = |name: &str, type_name: &str, answer: Answer| {
        Service::new(endpoints, &format!("{node}/{name}"), &format!("rcl_interfaces/srv/{type_name}"), answer)
    };
    let shared = || Arc::clone(&all);
    let [get, types, list, describe, set, atomically] = [shared(), shared(), shared(), shared(), shared(), shared()];
    Ok(vec![
        service("get_parameters", "GetParameters", names_answer(move |name| get.get(&name)))?,
        service("get_parameter_types", "GetParameterTypes", names_answer(move |name| types.get(&name).r#type))?,
        service("describe_parameters", "DescribeParameters", names_answer(move |name| describe.describe(name)))?,
        service("list_parameters", "ListParameters", Box::new(move |bytes| to_cdr(&list.list(&from_cdr(bytes)?))))?,
        service(
            "set_parameters",
            "SetParameters",
            Box::new(move |bytes| {
                let NewValues { parameters } = from_cdr(bytes)?;
                to_cdr(&parameters.iter().map(|parameter| set.set(parameter)).collect::<Vec<_>>())
            }),
        )?,
        service(
            "set_parameters_atomically",
            "SetParametersAtomically",
            Box::new(move |bytes| {
                let NewValues { parameters } = from_cdr(bytes)?;
                let refusal = parameters.iter().find_map(|parameter| atomically.refusal(parameter));
                if refusal.is_none() {
                    parameters.iter().for_each(|parameter| drop(atomically.set(parameter)));
                }
                to_cdr(&SetResult { successful: refusal.is_none(), reason: refusal.unwrap_or_default() })
            }),
        )?,
    ])
}

/// Answers a list of names with something about each.
fn names_answer<T: Serialize>(about: impl Fn(String) -> T + Send + 'static) -> Answer {
    Box::new(move |bytes| {
        let Names { names } = from_cdr(bytes)?;
        to_cdr(&names.into_iter().map(&about).collect::<Vec<_>>())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters() -> Parameters {
        let fixed = [("memory.max_gaussians", ParameterValue::Integer(5)), ("poses", ParameterValue::Bool(true))];
        Parameters::new(fixed.map(|(name, value)| (name.to_owned(), value)).into(), SimTime::default())
    }

    fn list(prefixes: &[&str], depth: u64) -> [Vec<String>; 2] {
        parameters().list(&Listed { prefixes: prefixes.iter().map(ToString::to_string).collect(), depth })
    }

    #[test]
    fn parameters_are_listed_by_prefix_and_depth() {
        assert_eq!(list(&[], 0), [vec!["memory.max_gaussians", "poses", "use_sim_time"], vec!["memory"]]);
        assert_eq!(list(&[], 1), [vec!["poses", "use_sim_time"], vec![]]);
        assert_eq!(list(&["memory"], 1), [vec!["memory.max_gaussians"], vec!["memory"]]);
        assert_eq!(list(&["mem"], 1), [Vec::<&str>::new(), vec![]]);
    }

    #[test]
    fn only_use_sim_time_can_be_set() {
        let all = parameters();
        let parameter = |name: &str, value| Parameter { name: name.to_owned(), value: Value::from(&value) };
        assert!(all.set(&parameter(USE_SIM_TIME, ParameterValue::Bool(true))).successful);
        assert!(all.get(USE_SIM_TIME).bool_value);
        let refused = all.set(&parameter("poses", ParameterValue::Bool(false)));
        assert_eq!(refused.reason, "poses: read only; it is an option of splatseg ros2");
        assert_eq!(all.set(&parameter("x", ParameterValue::Double(1.0))).reason, "x: no such parameter");
        assert!(!all.set(&parameter(USE_SIM_TIME, ParameterValue::Integer(1))).successful);
    }
}
