//! `splatseg live --view`: the page, Foxglove, and who may connect.

use crate::browser::Browser;
use crate::support::{finish, splatseg, stoppable_splatseg};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// The longest wait for something that should happen soon.
const PATIENCE: Duration = Duration::from_secs(15);

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap")
}

/// A running `splatseg live --view` that plays slowly; killed when dropped.
struct Live {
    child: Child,
    /// `127.0.0.1:PORT`.
    address: String,
    token: String,
}

impl Live {
    fn start() -> Self {
        Self::play("0.02")
    }

    /// Plays the recording at this speed.
    fn play(speed: &str) -> Self {
        Self::play_with(speed, &[])
    }

    fn play_with(speed: &str, more: &[&str]) -> Self {
        let mut command = stoppable_splatseg();
        command.arg("live").arg(recording()).args(more).args([
            "--view=127.0.0.1:0",
            "--speed",
            speed,
            "--threads",
            "2",
        ]);
        let mut child =
            command.args(["--world-frame", "map"]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        let link = lines.find_map(|line| line.split_once("http://").map(|(_, link)| link.to_owned())).unwrap();
        let (address, token) = link.split_once("/?token=").unwrap();
        // Read to the end, so that the command can always write.
        std::thread::spawn(move || lines.count());
        Self { child, address: address.to_owned(), token: token.to_owned() }
    }

    /// Ends the session as Ctrl-C does.
    fn interrupt(&self) {
        let mut kill = std::process::Command::new("kill");
        assert!(kill.args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
    }

    /// Waits for the end after [`Self::interrupt`]; the recording may have ended before.
    fn assert_ended(&mut self) {
        let status = self.child.wait().unwrap();
        assert!([Some(0), Some(130)].contains(&status.code()), "{status}");
    }

    /// The status line of the page's response.
    fn get(&self, target: &str) -> String {
        let mut tcp = TcpStream::connect(&self.address).unwrap();
        let request = format!("GET {target} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.address);
        tcp.write_all(request.as_bytes()).unwrap();
        let mut response = String::new();
        tcp.read_to_string(&mut response).unwrap();
        response.lines().next().unwrap().to_owned()
    }

    fn socket(&self, path: &str, subprotocol: Option<&str>) -> WebSocket<TcpStream> {
        let url = format!("ws://{}{path}?token={}", self.address, self.token);
        let mut request = url.into_client_request().unwrap();
        if let Some(subprotocol) = subprotocol {
            request.headers_mut().insert("Sec-WebSocket-Protocol", subprotocol.parse().unwrap());
        }
        let tcp = TcpStream::connect(&self.address).unwrap();
        tcp.set_read_timeout(Some(PATIENCE)).unwrap();
        tungstenite::client::client(request, tcp).unwrap().0
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The JSON of a message of the page: all of a text, or the start of binary data.
fn header(message: &Message) -> Value {
    match message {
        Message::Text(text) => serde_json::from_str(text).unwrap(),
        Message::Binary(bytes) => {
            let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
            serde_json::from_slice(&bytes[4..4 + length]).unwrap()
        }
        _ => Value::Null,
    }
}

#[test]
fn the_page_shows_frames_the_map_and_objects() {
    let live = Live::start();
    assert!(live.get("/").contains(" 403 "), "without the token nothing is served: {}", live.get("/"));
    assert!(live.get(&format!("/?token={}", live.token)).contains(" 200 "));
    let mut socket = live.socket("/live", None);
    let (started, mut missing) = (Instant::now(), BTreeSet::from(["frame", "map", "boxes"]));
    while !missing.is_empty() {
        assert!(started.elapsed() < PATIENCE, "missing: {missing:?}");
        let message = header(&socket.read().unwrap());
        let kind = message["kind"].as_str().unwrap_or_default();
        missing.remove(kind);
        if kind == "objects" && message["objects"].as_array().unwrap().iter().any(|object| object["box"].is_object()) {
            missing.remove("boxes");
        }
        socket.send(Message::text("shown")).unwrap();
    }
}

#[test]
fn the_page_in_a_browser_says_where_poses_come_from_and_when_the_session_ends() {
    let test = "the_page_in_a_browser_says_where_poses_come_from_and_when_the_session_ends";
    let Some(mut browser) = Browser::start(test, 1000, 720) else { return };
    let live = Live::play("0.1");
    browser.open_url(&format!("http://{}/?token={}", live.address, live.token));
    let says = |text: &str| format!("document.getElementById('live')?.textContent.includes('{text}') ?? false");
    browser.wait_for(&says("poses given"));
    browser.wait_for("document.querySelector('#list .crop')?.naturalWidth > 0");
    // The page draws the overlay itself, so that it can be left out.
    let is_drawn = "(() => { const canvas = document.getElementById('drawn'); if (canvas.hidden || !canvas.width) return false; \
        return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value > 0); })()";
    browser.wait_for(is_drawn);
    browser.press("o");
    assert_eq!(browser.value("document.getElementById('drawn').style.opacity"), "0");
    browser.wait_for(&says("the session has ended"));
    assert_eq!(browser.value("document.documentElement.dataset.state"), "ended");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_live_page_has_a_timeline_isolates_objects_and_merges_them_in_the_saved_map() {
    let test = "the_live_page_has_a_timeline_isolates_objects_and_merges_them_in_the_saved_map";
    let Some(mut browser) = Browser::start(test, 1440, 900) else { return };
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("home.ply");
    let mut live = Live::play_with("0.03", &["--map", map.to_str().unwrap()]);
    browser.open_url(&format!("http://{}/?token={}", live.address, live.token));
    // Rows of objects that count, with bars in their colours; tentative ones are folded away in the list.
    browser.wait_for(
        "window.splatsegPage?.run.objects.filter(({ state, box }) => state === 'remembered' && box).length > 3",
    );
    browser.wait_for(
        "(() => { const rows = [...document.querySelectorAll('#tracks button')].map(({ dataset }) => Number(dataset.object)); \
         const { run } = splatsegPage; return rows.length > 3 && rows.every((id) => run.byId.get(id)?.state === 'remembered'); })()",
    );
    browser.wait_for(
        "[...document.querySelectorAll('#list li:not([hidden]) button')].every(({ dataset }) => \
         splatsegPage.run.byId.get(Number(dataset.object))?.state === 'remembered')",
    );
    browser.wait_for(
        "(() => { const canvas = document.getElementById('spans'); const id = Number(document.querySelector('#tracks button').dataset.object); \
         const { color } = splatsegPage.run.byId.get(id); const data = canvas.getContext('2d').getImageData(0, 9, canvas.width, 1).data; \
         for (let at = 0; at < data.length; at += 4) if (color.every((value, channel) => value === data[at + channel])) return true; \
         return false; })()",
    );
    let ids = browser.value(
        "splatsegPage.run.objects.filter(({ state, box }) => state === 'remembered' && box).map(({ id }) => id) \
         .sort((one, other) => one - other).slice(0, 2)",
    );
    let [into, from] = [0, 1].map(|place| ids[place].as_u64().unwrap());
    browser.wait_for("splatsegPage.map() !== null");
    browser.click_on(&format!("#tracks [data-object='{from}']"));
    browser.press("i");
    let is_alone = format!(
        "[...splatsegPage.map().splats.ids].every((id, at) => (id === {from}) === Boolean(splatsegPage.map().splats.shown[at]))"
    );
    browser.wait_for(&is_alone);
    browser.press("i");
    browser.press("u");
    browser.click_on(&format!("#tracks [data-object='{into}']"));
    browser.click_on("#merge");
    browser.wait_for(&format!("document.documentElement.dataset.object === '{into}'"));
    browser.wait_for(&format!(
        "!splatsegPage.run.byId.has({from}) && splatsegPage.run.byId.has({into}) && !splatsegPage.map().splats.ids.includes({from})"
    ));
    live.interrupt();
    browser.wait_for("document.documentElement.dataset.state === 'ended'");
    live.assert_ended();
    // The plan of the whole map has come before the end, with its rooms and the objects that were merged as one.
    browser.wait_for("Number(document.documentElement.dataset.rooms) > 0");
    browser.press("p");
    assert_eq!(browser.value("splatsegPage.plan().isOn && !document.getElementById('plan').hidden"), true);
    assert_eq!(
        browser.value(&format!("splatsegPage.run.plan.objects.some(({{ id }}) => id === {from})")),
        false,
        "the plan is of the map after the merge"
    );
    let floor = "(() => { const canvas = document.getElementById('plan'); splatsegPage.plan().drawNow(); \
        const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data; \
        return data.some((value, at) => at % 4 === 3 && value > 0); })()";
    assert_eq!(browser.value(floor), true, "the plan is drawn");
    let list = splatseg::pipeline::NamedMap::load(&map).unwrap().object_list();
    assert!(list.get(from as u32).is_none() && list.get(into as u32).is_some());
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_live_page_names_objects_finds_them_by_words_and_chooses_the_detail() {
    let test = "the_live_page_names_objects_finds_them_by_words_and_chooses_the_detail";
    let Some(mut browser) = Browser::start(test, 1440, 900) else { return };
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("home.ply");
    let mut live = Live::play_with("0.03", &["--map", map.to_str().unwrap()]);
    browser.open_url(&format!("http://{}/?token={}", live.address, live.token));
    let remembered =
        "[...(window.splatsegPage?.run.objects ?? [])].filter(({ state, box }) => state === 'remembered' && box)";
    browser.wait_for(&format!("{remembered}.length > 3"));
    browser.wait_for("document.querySelectorAll('#tracks button').length > 3");
    let id = browser.value("Number(document.querySelector('#tracks button').dataset.object)").as_u64().unwrap();
    browser.click_on(&format!("#tracks [data-object='{id}']"));
    browser.wait_for("!document.querySelector('#objects form').hidden");
    browser.press("n");
    browser.call("Input.insertText", json!({ "text": "reading lamp" }));
    browser.click_on("#objects form button");
    browser.wait_for("document.querySelector('#objects form .note').textContent === 'saved'");
    // No label has this text: the program answers.
    browser.click_on("#filter");
    browser.call("Input.insertText", json!({ "text": "the lamp" }));
    browser.wait_for(&format!(
        "(() => {{ const shown = [...document.querySelectorAll('#list li:not([hidden]) button')]; \
         return shown.length === 1 && shown[0].dataset.object === '{id}'; }})()"
    ));
    // Later frames are segmented as chosen; the page shows what the program says.
    let detail = "document.querySelector('#detail select').value";
    assert_eq!(browser.value(detail), "normal");
    browser.value(
        "(() => { const choice = document.querySelector('#detail select'); choice.value = 'fine'; \
         choice.dispatchEvent(new Event('change')); })()",
    );
    // The label comes with the next frame, too.
    browser.wait_for("document.documentElement.dataset.detail === 'fine'");
    browser.wait_for(&format!("splatsegPage.run.byId.get({id}).label === 'reading lamp'"));
    assert_eq!(browser.value(detail), "fine");
    live.interrupt();
    browser.wait_for("document.documentElement.dataset.state === 'ended'");
    // Nobody answers any more.
    let is_closed = "document.querySelector('#objects form').hidden && document.getElementById('detail').hidden \
        && document.getElementById('filter').placeholder === 'Find an id or a label'";
    assert_eq!(browser.value(is_closed), true);
    live.assert_ended();
    let saved = splatseg::pipeline::NamedMap::load(&map).unwrap();
    let objects = saved.object_list();
    assert_eq!(objects.get(id as u32).unwrap().label.as_deref(), Some("reading lamp"));
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn foxglove_gets_each_output() {
    let live = Live::start();
    let mut socket = live.socket("/", Some("foxglove.sdk.v1"));
    let channels = loop {
        let message = header(&socket.read().unwrap());
        if message["op"] == "advertise" {
            break message["channels"].clone();
        }
    };
    let channels = channels.as_array().unwrap();
    let topics: Vec<_> = channels.iter().map(|channel| channel["topic"].as_str().unwrap()).collect();
    let splatseg =
        ["objects", "markers", "ids", "overlay/compressed", "points"].map(|name| format!("/splatseg/{name}"));
    assert_eq!(topics[..5], splatseg);
    assert_eq!(topics[5..], ["/splatseg/map", "/tf_static", "/splatseg/scene_graph", "/tf", "/diagnostics"]);
    let subscriptions: Vec<_> =
        channels.iter().map(|channel| json!({ "id": channel["id"], "channelId": channel["id"] })).collect();
    let subscribe = json!({ "op": "subscribe", "subscriptions": subscriptions });
    socket.send(Message::text(subscribe.to_string())).unwrap();
    // All but the camera's pose, which came with the recording, and the frame of the plan, as z points up.
    let mut missing: BTreeSet<u64> = channels
        .iter()
        .filter(|channel| !["/tf", "/tf_static"].map(Value::from).contains(&channel["topic"]))
        .map(|channel| channel["id"].as_u64().unwrap())
        .collect();
    let started = Instant::now();
    while !missing.is_empty() {
        assert!(started.elapsed() < PATIENCE, "missing: {missing:?} of {topics:?}");
        if let Message::Binary(bytes) = socket.read().unwrap() {
            missing.remove(&u64::from(u32::from_le_bytes(bytes[1..5].try_into().unwrap())));
        }
    }
}

#[test]
fn a_port_in_use_is_one_line() {
    let live = Live::start();
    let mut command = splatseg();
    command.arg("live").arg(recording()).arg(format!("--view={}", live.address));
    let ended = finish(&mut command);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains(&live.address), "{}", ended.err);
}
