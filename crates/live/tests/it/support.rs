//! Sessions on the messages of a small recording, whose results are collected.

use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{DatasetSettings, read_messages};
use splatseg_live::{BuildPipeline, LiveOptions, LiveSession, LiveStatus, LiveStream, Outlet, Output};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Everything published, in order.
pub(crate) type Published = Arc<Mutex<Vec<(Output, Vec<u8>)>>>;

pub(crate) struct Collector {
    published: Published,
    shown: Arc<Mutex<Vec<LiveStatus>>>,
}

impl Outlet for Collector {
    fn wants(&self, output: Output) -> bool {
        output != Output::Overlay
    }

    fn publish(&mut self, output: Output, message: Vec<u8>) {
        self.published.lock().unwrap().push((output, message));
    }

    fn show(&mut self, status: &LiveStatus) {
        self.shown.lock().unwrap().push(status.clone());
    }
}

pub(crate) struct Setting {
    pub(crate) stream: Arc<LiveStream>,
    pub(crate) published: Published,
    pub(crate) shown: Arc<Mutex<Vec<LiveStatus>>>,
    pub(crate) session: LiveSession,
}

pub(crate) fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap")
}

pub(crate) fn setting(options: LiveOptions, load: Option<&Path>) -> Setting {
    let settings: Settings = SettingsLayers::default().resolve().unwrap();
    let build: BuildPipeline = Box::new(move |map| match map {
        Some(map) => Pipeline::builder(&settings).saved_memory(map).build(),
        None => Pipeline::builder(&settings).build(),
    });
    setting_with(build, options, load)
}

pub(crate) fn setting_with(build: BuildPipeline, options: LiveOptions, load: Option<&Path>) -> Setting {
    let mut dataset = DatasetSettings::default();
    dataset.world_frame = Some("map".to_owned());
    let stream = Arc::new(LiveStream::without_drops(&dataset).unwrap());
    let (published, shown) = (Published::default(), Arc::default());
    let outlet = Collector { published: Arc::clone(&published), shown: Arc::clone(&shown) };
    let session = LiveSession::new(build, load, (Arc::clone(&stream), Box::new(outlet)), options).unwrap();
    Setting { stream, published, shown, session }
}

/// Feeds a stream with the recording.
pub(crate) fn feed(stream: &LiveStream) {
    read_messages(&recording(), &mut |message| {
        stream.feed_at((message.topic, message.type_name), message.data, message.recorded);
        Ok(())
    })
    .unwrap();
}

/// Plays the recording into a session until its end.
pub(crate) fn play(setting: &mut Setting) {
    let stream = Arc::clone(&setting.stream);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            feed(&stream);
            stream.end();
        });
        setting.session.run(&mut || false).unwrap();
    });
}
