//! A saved map for assistants: a server of the Model Context Protocol (MCP, [`rmcp`]) with tools that list, find, show and
//! name the map's objects.
//!
//! | file | content |
//! | --- | --- |
//! | `assistant.rs` | the map and what the tools may do with it; a call of a tool by name |
//! | `open_map.rs` | the map, loaded again when its file has changed |
//! | `sightings.rs` | when each object was seen, from `objects.json` |
//! | `object_reference.rs` | which object a client means |
//! | `tool.rs`, `tools/` | the tools, one in each file |
//! | `facts.rs` | what the answers tell of an object |
//! | `boxes.rs` | distances and footprints of boxes |
//! | `canvas.rs`, `plan.rs` | pictures |
//! | `places.rs` | rooms, free space and routes, from whoever knows them |
//! | `floor_places.rs` | the same from the map's floor plan |
//! | `server.rs` | the protocol, over a pair of byte streams |
//! | `lines.rs` | errors for lines that are no messages |
//! | `http.rs` | the same over HTTP |
//!
//! `docs/ASSISTANT.md` explains the tools to users.

mod assistant;
mod boxes;
mod canvas;
mod error;
mod facts;
mod floor_places;
mod http;
mod lines;
mod object_reference;
mod open_map;
mod places;
mod plan;
mod server;
mod sightings;
mod tool;
mod tools;

pub use assistant::{Assistant, AssistantOptions};
pub use error::McpError;
pub use floor_places::floor_places;
pub use http::{HttpOptions, HttpServer};
pub use places::{Destination, OpenPlaces, PlaceRoom, Places};
pub use server::{MAX_MESSAGE_BYTES, MapServer, serve_stdio};
pub use tool::{Outcome, Picture};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
