//! A map of the synthetic room, and a client.

use rmcp::ServiceExt;
use rmcp::model::{CallToolRequestParams, CallToolResult};
use rmcp::service::{RoleClient, RunningService};
use serde_json::Value;
use splatseg::Pipeline;
use splatseg::memory::Attached;
use splatseg::pipeline::NamedMap;
use splatseg::settings::SettingsLayers;
use splatseg_dataset::{FrameStream, GroundTruth, open_scene};
use splatseg_files::StateBlock;
use splatseg_mcp::{Assistant, AssistantOptions, MapServer};
use splatseg_objects::{SeenTime, SeenTimes};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Saves a map of a scene, seen by the oracle segmenter, that continues another map.
pub fn save_map(scene: &str, map: &Path, earlier: Option<&Path>) {
    let mut layers = SettingsLayers::default();
    for assignment in ["segmenter=oracle", "min_area=12"] {
        layers.add_assignment(assignment).unwrap();
    }
    let settings = layers.resolve().unwrap();
    let scene = open_scene(scene, &settings.dataset).unwrap();
    let mut builder = Pipeline::builder(&settings).scene(&scene);
    if let Some(earlier) = earlier {
        builder = builder.saved_memory(earlier);
    }
    let mut pipeline = builder.build().unwrap();
    for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Read).unwrap()) {
        processed.unwrap().result.unwrap();
    }
    assert!(pipeline.save_memory(map).unwrap());
}

/// A folder with a copy of the map of a room, made once.
pub fn room() -> (TempDir, PathBuf) {
    static ROOM: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, original) = ROOM.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("room.ply");
        save_map("synthetic:frames=24,width=160,height=120,objects=8", &map, None);
        let mut named = NamedMap::load(&map).unwrap();
        let ids: Vec<u32> = by_size(&named);
        named.names.set_by_hand(ids[0], Some("mug")).unwrap();
        named.names.set_by_hand(ids[1], Some("table")).unwrap();
        named.names.set_by_hand(ids[2], Some("table")).unwrap();
        named.save(&map).unwrap();
        (folder, map)
    });
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("room.ply");
    fs::copy(original, &map).unwrap();
    (folder, map)
}

/// The objects of a map, the smallest first.
pub fn by_size(map: &NamedMap) -> Vec<u32> {
    let list = map.object_list();
    let mut sized: Vec<(f32, u32)> = list
        .objects
        .iter()
        .filter_map(|object| Some((object.shape.as_ref()?.oriented_box.size.element_product(), object.id)))
        .collect();
    sized.sort_by(|one, other| one.0.total_cmp(&other.0));
    sized.into_iter().map(|(_, id)| id).collect()
}

/// Saves a map with times at which its objects were seen: `times` makes the first and the last, seconds, of the number of the
/// last frame.
pub fn save_times(map: &Path, times: impl Fn(u32) -> [f64; 2]) {
    let named = NamedMap::load(map).unwrap();
    let mut seen = SeenTimes::default();
    for (id, frame) in named.memory.last_seen() {
        let [first_s, last_s] = times(frame);
        seen.add(id, SeenTime { first_s, last_s });
    }
    let mut history = StateBlock::default();
    history.put_block("seen", seen.to_block());
    let (history, names) = (history.to_bytes().unwrap(), named.names.to_bytes());
    let attached = Attached { keyframes: named.keyframes.as_deref(), names: Some(&names), history: Some(&history) };
    named.memory.save_with(map, attached).unwrap();
}

/// Options for a map.
pub fn options(map: &Path) -> AssistantOptions {
    AssistantOptions { map: map.to_owned(), ..AssistantOptions::default() }
}

/// Runs a test with the SDK's own client, connected to an assistant in memory.
pub fn with_client<F: AsyncFnOnce(&Client)>(assistant: Assistant, test: F) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let (here, there) = tokio::io::duplex(1 << 16);
        let (from_client, to_client) = tokio::io::split(there);
        let server = tokio::spawn(MapServer::new(assistant).serve_on(from_client, to_client));
        let client = Client(().serve(here).await.unwrap());
        test(&client).await;
        client.0.cancel().await.unwrap();
        server.await.unwrap().unwrap();
    });
}

/// A client of the SDK.
pub struct Client(pub RunningService<RoleClient, ()>);

impl Client {
    /// Calls a tool.
    pub async fn call(&self, name: &'static str, arguments: Value) -> CallToolResult {
        let Value::Object(arguments) = arguments else { panic!("arguments are an object") };
        self.0.call_tool(CallToolRequestParams::new(name).with_arguments(arguments)).await.unwrap()
    }

    /// Calls a tool that answers. Returns its text and data.
    pub async fn ask(&self, name: &'static str, arguments: Value) -> (String, Value) {
        let result = self.call(name, arguments).await;
        assert_eq!(result.is_error, Some(false), "{name}: {}", text(&result));
        let data = result.structured_content.clone().unwrap();
        (text(&result), data)
    }

    /// Calls a tool that refuses. Returns what it says.
    pub async fn refused(&self, name: &'static str, arguments: Value) -> String {
        let result = self.call(name, arguments).await;
        assert!(result.is_error == Some(true) && result.structured_content.is_none(), "{name}: {}", text(&result));
        text(&result)
    }
}

/// The text of an answer.
pub fn text(result: &CallToolResult) -> String {
    result.content.first().and_then(|content| content.as_text()).map(|text| text.text.clone()).unwrap_or_default()
}
