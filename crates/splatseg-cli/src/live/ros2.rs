//! `splatseg ros2`: a ROS 2 node without ROS.

use super::session_options::SessionOptions;
use crate::run::StopSignals;
use crate::system_limits::{no_thread, use_threads};
use crate::{Failure, devices};
use clap::Args;
use serde_json::Value;
use splatseg::Settings;
use splatseg_dataset::MatchLimits;
use splatseg_live::LiveStream;
use splatseg_ros2::{DiscoveryRange, Domain, NodeName, ParameterValue, Ros2Node};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::sync::Arc;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg ros2 --map home.ply\n  \
    splatseg ros2 --map home.ply --color /camera/color/image_raw --depth /camera/aligned_depth_to_color/image_raw\n  \
    splatseg ros2 --map home.ply --poses track --discovery-range subnet\n  \
    splatseg ros2 --map home.ply --depth none --depth-weights depth_anything_v2_metric_hypersim_vits.pth\n  \
    splatseg ros2 --view\n\n\
    Topics are found by their types, or named as for recordings (--color, --depth, --camera-info, --pose). Ctrl-C or\n\
    SIGTERM ends it after the present frame; the map is saved then, and every --save-interval seconds. Started again with\n\
    the same map, it goes on. docs/LIVE.md lists its topics, services and parameters.")]
pub struct Ros2Arguments {
    /// Name of the node
    #[arg(long, value_name = "NAME", default_value = "splatseg")]
    pub name: String,
    /// Namespace of the node
    #[arg(long, value_name = "/NAMESPACE", default_value = "/")]
    pub namespace: String,
    /// Domain, 0 to 101. [default: ROS_DOMAIN_ID, or 0]
    #[arg(long, value_name = "ID")]
    pub domain_id: Option<String>,
    /// Who can see the node: localhost or subnet. [default: ROS_AUTOMATIC_DISCOVERY_RANGE, or localhost]
    #[arg(long, value_name = "RANGE")]
    pub discovery_range: Option<String>,
    /// Take the time of messages without a stamp of their own from /clock
    #[arg(long)]
    pub use_sim_time: bool,
    #[command(flatten)]
    pub session: SessionOptions,
}

impl Ros2Arguments {
    fn domain(&self) -> Result<Domain, Failure> {
        let given = |name: &str| match name {
            "ROS_DOMAIN_ID" => self.domain_id.clone(),
            "ROS_AUTOMATIC_DISCOVERY_RANGE" => self.discovery_range.as_ref().map(|range| range.to_uppercase()),
            _ => None,
        };
        Domain::from_environment(|name| given(name).or_else(|| std::env::var(name).ok())).map_err(Failure::input)
    }
}

/// Executes `splatseg ros2`.
pub fn ros2(arguments: &Ros2Arguments, program: &[OsString]) -> Result<(), Failure> {
    let mut settings = arguments.session.settings()?;
    settings.settle_depth_of_stream("--depth none").map_err(Failure::input)?;
    let _files = arguments.session.check(&settings, None)?;
    let (domain, name) = (arguments.domain()?, NodeName::new(&arguments.namespace, &arguments.name));
    let name = name.map_err(Failure::input)?;
    devices::check(settings.device(), program)?;
    use_threads(settings.run.threads)?;
    settings.run.memory_limit.enforce();
    let signals = StopSignals::listen().map_err(|error| no_thread("listens for signals", &error))?;
    let stream = Arc::new(LiveStream::new(&settings.dataset, MatchLimits::default()).map_err(Failure::input)?);
    let parameters = parameters(&settings);
    let mut node = Ros2Node::join(domain, name).map_err(Failure::runtime)?;
    node.use_sim_time(arguments.use_sim_time);
    let outlet = node.outlet().map_err(Failure::runtime)?;
    let full_name = node.full_name();
    let mut session = arguments.session.session(settings, &stream, vec![Box::new(outlet)], &full_name)?;
    arguments.session.start_recording(&stream)?;
    say_error!("node {full_name}, domain {}, visible to {}", domain.id, domain.range);
    if domain.range == DiscoveryRange::Localhost {
        say_error!("nodes of other computers: --discovery-range subnet");
    }
    let report = Box::new(|line: &str| say_error!("  {line}"));
    node.start(Arc::clone(&stream), &session.requests(), parameters, report).map_err(Failure::runtime)?;
    let ended = session.run(&mut || signals.received().is_some());
    // The node waits for its services, which wait for the session. The recording waits for neither.
    session.close_requests();
    stream.end();
    let finished = arguments.session.finish(&session, &stream, ended, Ok(()));
    drop(node);
    finished
}

/// The settings as parameters, by the names of their keys. Those that are not set are left out.
fn parameters(settings: &Settings) -> BTreeMap<String, ParameterValue> {
    let mut parameters = BTreeMap::new();
    let mut left = vec![(String::new(), serde_json::to_value(settings).unwrap_or_default())];
    while let Some((name, value)) = left.pop() {
        let parameter = match value {
            Value::Object(fields) => {
                let prefix = if name.is_empty() { name } else { format!("{name}.") };
                left.extend(fields.into_iter().map(|(key, value)| (format!("{prefix}{key}"), value)));
                continue;
            }
            Value::Null => continue,
            Value::Bool(value) => ParameterValue::Bool(value),
            Value::String(value) => ParameterValue::String(value),
            Value::Number(value) => match (value.as_i64(), value.as_f64()) {
                (Some(value), _) => ParameterValue::Integer(value),
                (None, value) => ParameterValue::Double(value.unwrap_or(f64::NAN)),
            },
            Value::Array(_) => ParameterValue::String(value.to_string()),
        };
        parameters.insert(name, parameter);
    }
    parameters
}
