//! The map and what the tools may do with it.

use crate::open_map::OpenMap;
use crate::places::OpenPlaces;
use crate::tool::{Outcome, ToolEntry};
use crate::tools;
use crate::{McpError, Places};
use rmcp::model::JsonObject;
use splatseg::names::ClipNames;
use splatseg::pipeline::NamedMap;
use std::path::PathBuf;

/// The files that an assistant is given, and whether it may write.
#[derive(Debug, Default)]
pub struct AssistantOptions {
    /// The map: a memory saved by a run or a live session.
    pub map: PathBuf,
    /// The `objects.json` of the run that saved the map: it tells when each object was seen. Without one, that of a live
    /// session beside the map is read, `home.objects.json` for `home.ply`, if there is one.
    pub objects: Option<PathBuf>,
    /// An earlier map of the place, to tell what has changed.
    pub earlier: Option<PathBuf>,
    /// A network with which objects are found by what they look like. The map must have been named with it.
    pub network: Option<ClipNames>,
    /// Allow tools to change the map's file.
    pub allow_write: bool,
}

/// The map of a server with its tools.
pub struct Assistant {
    pub(crate) map: OpenMap,
    pub(crate) earlier: Option<NamedMap>,
    pub(crate) earlier_path: Option<PathBuf>,
    pub(crate) network: Option<ClipNames>,
    tools: Vec<ToolEntry>,
    allow_write: bool,
}

impl Assistant {
    /// Loads the map. Rooms, free space and routes are not known.
    ///
    /// # Errors
    /// If the map, the earlier map or the objects cannot be read.
    pub fn open(options: AssistantOptions) -> Result<Self, McpError> {
        let none = |_: &NamedMap| Err("this program does not look for them".to_owned());
        Self::with_places(options, Box::new(none))
    }

    /// Loads the map, and finds its places with `open_places` each time that it is loaded.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn with_places(options: AssistantOptions, open_places: OpenPlaces) -> Result<Self, McpError> {
        let mut map = OpenMap::open(&options, open_places)?;
        if options.network.is_some() && map.current().map.names.embeddings().next().is_none() {
            let problem =
                "its objects were not named with a network: run `splatseg name MAP --names FILE` first".to_owned();
            return Err(McpError::File { path: options.map, problem });
        }
        let earlier = options.earlier.as_ref().map(NamedMap::load).transpose()?;
        let AssistantOptions { earlier: earlier_path, network, allow_write, .. } = options;
        let mut assistant = Self { map, earlier, earlier_path, network, tools: Vec::new(), allow_write };
        assistant.tools = tools::all(allow_write);
        Ok(assistant)
    }

    /// The tools that clients may call.
    pub fn tools(&self) -> impl Iterator<Item = &rmcp::model::Tool> {
        self.tools.iter().map(|tool| &tool.definition)
    }

    /// Describes the map and the use of the tools. A client reads it once, before it calls a tool, so it contains nothing that
    /// changes with the map's file.
    pub fn instructions(&mut self) -> String {
        let path = self.map.path().display().to_string();
        let allow_write = self.allow_write;
        let up = self.map.current().up;
        let mut text = format!(
            "A map of a place, made by a depth camera: {path}. Each object has an id that stays the same. Positions are in \
             the map's coordinates, in metres; up is about [{:.2}, {:.2}, {:.2}]. Start with list_objects or find_objects; \
             plan_view shows the place from above, picture_of shows an object. Names come from people and from networks \
             that may be wrong: look at a picture if it matters. When the map's file changes, the next answer is of the \
             new one.",
            up.x, up.y, up.z
        );
        text += if allow_write {
            " name_object and name_room change names in the file; nothing else is changed."
        } else {
            " Nothing can be changed."
        };
        text
    }

    /// Calls a tool. `None` if there is none of this name.
    pub fn call(&mut self, name: &str, arguments: JsonObject) -> Option<Outcome> {
        let call = self.tools.iter().find(|tool| tool.definition.name == name)?.call;
        let problem = self.map.refresh().err();
        let mut outcome = call(self, arguments);
        if let Some(problem) = problem {
            outcome.text = format!("{problem}\n{}", outcome.text);
        }
        Some(outcome)
    }

    /// The places of the map, or a sentence that says why they are not known.
    pub(crate) fn places(&mut self) -> Result<&dyn Places, String> {
        let places = self.map.current().places.as_deref();
        places.map_err(|reason| format!("Rooms and free space are not known: {reason}."))
    }
}
