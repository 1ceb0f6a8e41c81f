//! A node and a peer on loopback: a recording is published, results and replies come back, nonsense changes nothing.

use crate::endpoints::{Endpoints, Quality, Reader, Writer};
use crate::names::{dds_service, dds_topic, dds_type};
use crate::raw_cdr::RawCdr;
use crate::{Domain, NodeName, Ros2Node};
use rustdds::RTPSEntity;
use rustdds::discovery::DiscoveredReaderData;
use splatseg::Pipeline;
use splatseg::settings::SettingsLayers;
use splatseg_dataset::{DatasetSettings, MatchLimits, read_messages};
use splatseg_live::{BuildPipeline, LiveOptions, LiveSession, LiveStream, Outlet, SavedMap, Silent};
use splatseg_ros::{
    Detection3dArray, EmptyRequest, Image, OccupancyGrid, SetBoolRequest, SuccessResponse, from_cdr, to_cdr,
};
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(15);

/// A domain of its own for each test process and test.
fn domain(test: u32) -> Domain {
    Domain { id: (1 + (std::process::id() * 2 + test) % 100) as u16, ..Domain::default() }
}

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap")
}

fn stream(complete: usize) -> Arc<LiveStream> {
    let mut settings = DatasetSettings::default();
    settings.color = Some("/camera/color/image_raw/compressed".to_owned());
    settings.depth = Some("/camera/aligned_depth_to_color/image_raw/compressedDepth".to_owned());
    settings.world_frame = Some("map".to_owned());
    let limits = MatchLimits { complete, pose_wait: Duration::from_secs(2), ..MatchLimits::default() };
    Arc::new(LiveStream::new(&settings, limits).unwrap())
}

fn session(stream: &Arc<LiveStream>, outlet: Box<dyn Outlet>, map: Option<PathBuf>) -> LiveSession {
    let settings = SettingsLayers::default().resolve().unwrap();
    let build: BuildPipeline = Box::new(move |_| Pipeline::builder(&settings).build());
    let options = LiveOptions {
        saved_map: map.map(SavedMap::new),
        objects_interval: Duration::from_millis(100),
        plan_interval: Duration::from_millis(100),
        ..LiveOptions::default()
    };
    LiveSession::new(build, None, (Arc::clone(stream), outlet), options).unwrap()
}

/// Another node, e.g. a camera's driver.
struct Peer {
    endpoints: Endpoints,
    writers: BTreeMap<String, Writer>,
}

impl Peer {
    fn join(domain: Domain) -> Self {
        let endpoints = Endpoints::join(domain, NodeName::new("/", "camera").unwrap()).unwrap();
        Self { endpoints, writers: BTreeMap::new() }
    }

    fn writer(&mut self, topic: &str, type_name: &str) -> &Writer {
        let endpoints = &self.endpoints;
        let latched = topic == "/tf_static";
        self.writers.entry(topic.to_owned()).or_insert_with(|| {
            endpoints.writer(topic, type_name, Quality { latched, depth: 100, reliable: true }).unwrap()
        })
    }

    /// Waits until another node reads a DDS topic.
    fn wait_for_reader(&self, topic: &str) {
        wait(topic, || {
            let readers = self.endpoints.participant().discovered_readers();
            let is_reader = |reader: &DiscoveredReaderData| {
                reader.subscription_topic_data.topic_name() == topic
                    && !self.endpoints.is_own(reader.reader_proxy.remote_reader_guid)
            };
            readers.iter().any(is_reader)
        });
    }

    /// Calls a service until it replies.
    fn call(&self, service: &str, type_name: &str, request: Vec<u8>) -> Vec<u8> {
        let [requests, replies] = dds_service(service);
        let part = |part: &str| format!("{}{part}_", dds_type(type_name));
        let requests = self.endpoints.dds_writer(requests, part("Request"), Quality::RELIABLE).unwrap();
        let replies = self.endpoints.dds_reader(replies, part("Response"), Quality::RELIABLE).unwrap();
        self.wait_for_reader(&dds_service(service)[0]);
        let started = Instant::now();
        while started.elapsed() < LIMIT {
            requests.write(RawCdr(request.clone()), None).unwrap();
            let asked = Instant::now();
            while asked.elapsed() < Duration::from_secs(1) {
                replies.drain_read_notifications();
                match replies.try_take_one().unwrap() {
                    // Replies to others come, too.
                    Some(reply)
                        if reply.related_sample_identity().is_some_and(|to| to.writer_guid == requests.guid()) =>
                    {
                        return reply.into_value().0;
                    }
                    Some(_) => {}
                    None => std::thread::sleep(Duration::from_millis(10)),
                }
            }
        }
        panic!("{service}: no reply");
    }
}

fn taken(reader: &Reader) -> Vec<Vec<u8>> {
    reader.drain_read_notifications();
    std::iter::from_fn(|| reader.try_take_one().unwrap()).map(|message| message.into_value().0).collect()
}

fn wait(what: &str, mut is_done: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_done() {
        assert!(started.elapsed() < LIMIT, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The topics and types of the recording that the node may use.
fn topics(stream: &LiveStream) -> BTreeMap<String, String> {
    let mut topics = BTreeMap::new();
    read_messages(&recording(), &mut |message| {
        if stream.wants(message.topic, message.type_name) {
            topics.insert(message.topic.to_owned(), message.type_name.to_owned());
        }
        Ok(())
    })
    .unwrap();
    topics
}

/// A session on a node, which runs while `work` does.
fn while_running(domain: Domain, stream: &Arc<LiveStream>, map: Option<PathBuf>, work: impl FnOnce()) {
    let mut node = Ros2Node::join(domain, NodeName::default()).unwrap();
    let outlet = node.outlet().unwrap();
    let mut session = session(stream, Box::new(outlet), map);
    node.start(Arc::clone(stream), &session.requests(), BTreeMap::new(), Box::new(|_| {})).unwrap();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let running = scope.spawn(|| session.run(&mut || is_over.load(Ordering::Relaxed)));
        // Also if the work fails.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
        is_over.store(true, Ordering::Relaxed);
        running.join().unwrap().unwrap();
        if let Err(failure) = done {
            std::panic::resume_unwind(failure);
        }
    });
}

/// The objects of a session that is fed with the recording directly, and the cells of its map's plan.
fn expected() -> (Detection3dArray, Vec<i8>) {
    let stream = stream(100);
    let mut session = session(&stream, Box::new(Silent), None);
    read_messages(&recording(), &mut |message| {
        stream.feed(message.topic, message.type_name, message.data);
        Ok(())
    })
    .unwrap();
    stream.end();
    session.run(&mut || false).unwrap();
    let plan = session.pipeline_mut().floor_plan(Default::default()).unwrap();
    (session.detections(splatseg_objects::Object::counts), plan.grid().ros_values())
}

#[test]
fn topics_give_the_objects_of_their_recording_and_services_answer() {
    let (domain, stream, folder) = (domain(0), stream(100), tempfile::tempdir().unwrap());
    let map = folder.path().join("home.ply");
    while_running(domain, &stream, Some(map.clone()), || {
        let mut peer = Peer::join(domain);
        let latched = Quality { latched: true, depth: 1, reliable: true };
        let objects = peer.endpoints.reader("/splatseg/objects", "vision_msgs/msg/Detection3DArray", latched).unwrap();
        let ids = peer.endpoints.reader("/splatseg/ids", "sensor_msgs/msg/Image", Quality::RELIABLE).unwrap();
        for (topic, type_name) in topics(&stream) {
            peer.writer(&topic, &type_name);
            peer.wait_for_reader(&dds_topic(&topic));
        }
        // The node has to see the readers, too.
        std::thread::sleep(Duration::from_secs(1));
        read_messages(&recording(), &mut |message| {
            if let Some(writer) = peer.writers.get(message.topic) {
                writer.write(RawCdr(message.data.to_vec()), None).unwrap();
                std::thread::sleep(Duration::from_millis(2));
            }
            Ok(())
        })
        .unwrap();
        let mut stamps = Vec::new();
        wait("ids of all frames", || {
            stamps.extend(taken(&ids).iter().map(|message| from_cdr::<Image<'_>>(message).unwrap().header.stamp));
            stream.counts().frames == 4 && !stamps.is_empty()
        });
        let (expected, cells) = expected();
        assert!(expected.detections.len() > 5);
        wait("all objects", || {
            taken(&objects)
                .last()
                .is_some_and(|message| from_cdr::<Detection3dArray>(message).unwrap().detections == expected.detections)
        });

        // Whoever subscribes later gets the map that was made for nobody, since the saved objects have rooms.
        let maps = peer.endpoints.reader("/splatseg/map", "nav_msgs/msg/OccupancyGrid", latched).unwrap();
        assert!(cells.contains(&0) && cells.contains(&100), "free and occupied");
        wait("the map", || {
            taken(&maps).last().is_some_and(|message| {
                let grid: OccupancyGrid = from_cdr(message).unwrap();
                grid.header.frame_id == "map" && grid.data == cells
            })
        });

        let trigger = || to_cdr(&EmptyRequest::default()).unwrap();
        let reply = peer.call("/splatseg/save", "std_srvs/srv/Trigger", trigger());
        let SuccessResponse { success, message } = from_cdr(&reply).unwrap();
        assert!(success && map.exists(), "{message}");
        let pause = to_cdr(&SetBoolRequest { data: true }).unwrap();
        let reply: SuccessResponse = from_cdr(&peer.call("/splatseg/pause", "std_srvs/srv/SetBool", pause)).unwrap();
        assert_eq!(reply, SuccessResponse { success: true, message: "paused".to_owned() });
        let reply = peer.call("/splatseg/list_objects", "splatseg_msgs/srv/ListObjects", trigger());
        let (success, _, listed): (bool, String, Detection3dArray) = from_cdr(&reply).unwrap();
        assert!(success);
        assert_eq!(listed.detections, expected.detections);
        let id: i64 = listed.detections[0].id.parse().unwrap();
        let get = |id: i64| peer.call("/splatseg/get_object", "splatseg_msgs/srv/GetObject", to_cdr(&id).unwrap());
        let (success, _, found): (bool, String, Detection3dArray) = from_cdr(&get(id)).unwrap();
        assert!(success);
        assert_eq!(found.detections, listed.detections[..1]);
        let (success, message, _): (bool, String, Detection3dArray) = from_cdr(&get(-1)).unwrap();
        assert_eq!((success, message.as_str()), (false, "no such object"));
        let find = |text: &str| {
            let reply =
                peer.call("/splatseg/find_objects", "splatseg_msgs/srv/FindObjects", to_cdr(&text.to_owned()).unwrap());
            from_cdr::<(bool, String, Detection3dArray)>(&reply).unwrap()
        };
        let (success, _, found) = find("the largest one");
        assert!(success && !found.detections.is_empty() && found.detections.len() <= listed.detections.len());
        assert!(found.detections.iter().all(|found| listed.detections.iter().any(|listed| listed.id == found.id)));
        // That nothing fits is an answer.
        let (success, message, found) = find("piano");
        assert_eq!((success, message.as_str(), found.detections.len()), (true, "0 objects", 0));
    });
}

#[test]
fn nonsense_is_counted_and_changes_nothing() {
    let (domain, stream) = (domain(1), stream(100));
    while_running(domain, &stream, None, || {
        let mut peer = Peer::join(domain);
        let topics = topics(&stream);
        for (topic, type_name) in &topics {
            peer.writer(topic, type_name);
            peer.wait_for_reader(&dds_topic(topic));
        }
        // Pseudo-random bytes, the same in each run.
        let mut state = 1u64;
        let mut bytes = |len: usize| -> Vec<u8> {
            let mut next = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            };
            (0..len).map(|_| next()).collect()
        };
        for round in 0..20 {
            for writer in peer.writers.values() {
                writer.write(RawCdr([vec![0, 1, 0, 0], bytes(round * 37)].concat()), None).unwrap();
            }
        }
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let base = 7400 + 250 * domain.id;
        for round in 0..200 {
            // Random bytes, also behind the header of a message of RTPS 2.3 from a vendor that does not exist.
            let header = [b"RTPS".as_slice(), &[2, 3, 9, 9]].concat();
            let datagram = if round % 2 == 0 { bytes(round * 3) } else { [header, bytes(12 + round * 3)].concat() };
            for port in [0, 1, 10, 11, 12, 13, 14, 15] {
                // Nothing may listen on a port.
                let _ = socket.send_to(&datagram, ("127.0.0.1", base + port));
            }
        }
        wait("nonsense is counted", || stream.counts().damaged > 0);
        for service in ["save", "get_parameters"] {
            let [requests, _] = dds_service(&format!("/splatseg/{service}"));
            let type_name = if service == "save" { "std_srvs/srv/Trigger" } else { "rcl_interfaces/srv/GetParameters" };
            let writer = peer
                .endpoints
                .dds_writer(requests, format!("{}Request_", dds_type(type_name)), Quality::RELIABLE)
                .unwrap();
            peer.wait_for_reader(&dds_service(&format!("/splatseg/{service}"))[0]);
            (0..20).for_each(|len| writer.write(RawCdr([vec![0, 1, 0, 0], bytes(len)].concat()), None).unwrap());
        }
        // The node still answers. A map without objects gives an empty list, not an error.
        let all = to_cdr(&EmptyRequest::default()).unwrap();
        let reply = peer.call("/splatseg/list_objects", "splatseg_msgs/srv/ListObjects", all);
        let (success, message, listed): (bool, String, Detection3dArray) = from_cdr(&reply).unwrap();
        assert_eq!((success, message.as_str(), listed.detections.len()), (true, "0 objects", 0));
        let names = to_cdr(&vec!["use_sim_time".to_owned()]).unwrap();
        let reply = peer.call("/splatseg/get_parameter_types", "rcl_interfaces/srv/GetParameterTypes", names);
        assert_eq!(from_cdr::<Vec<u8>>(&reply).unwrap(), [1]);
        assert_eq!(stream.counts().frames, 0);
    });
}
