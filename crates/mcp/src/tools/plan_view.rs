//! `plan_view`: the map from above.

use crate::Assistant;
use crate::object_reference::ObjectReference;
use crate::plan::{PlanFacts, Shown, draw};
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::Deserialize;

/// Maximum number of objects to emphasise.
const MAX_OBJECTS: usize = 50;

/// The arguments of `plan_view`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Input {
    /// Objects to emphasise, at most 50: then only they have labels.
    #[schemars(length(max = 50))]
    objects: Vec<ObjectReference>,
}

/// The tool.
pub enum PlanView {}

impl Tool for PlanView {
    type Input = Input;
    type Output = PlanFacts;
    const NAME: &'static str = "plan_view";
    const TITLE: &'static str = "View from above";
    const DESCRIPTION: &'static str = "Shows the map from above as a picture, with the footprints, ids and names of its \
                                       objects and a scale. Objects can be emphasised.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<PlanFacts>, ToolError> {
        if input.objects.len() > MAX_OBJECTS {
            return Err(ToolError(format!("objects: found {}, expected at most {MAX_OBJECTS}.", input.objects.len())));
        }
        let objects = input.objects.iter().map(|object| assistant.meant(object)).collect::<Result<_, _>>()?;
        let map = assistant.map.current();
        let (picture, data) = draw(map, &Shown { objects, route: &[] })?;
        Ok(Answer { text: data.words(map), data, picture: Some(picture) })
    }
}
