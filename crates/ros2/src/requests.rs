//! The node's services: `std_srvs` for what the session does, `splatseg_msgs` for objects.

use crate::Ros2Error;
use crate::endpoints::Endpoints;
use crate::service::{Answer, Service};
use serde::{Deserialize, Serialize};
use splatseg_live::{LiveRequest, LiveSession, Requests};
use splatseg_objects::Object;
use splatseg_ros::{Detection3dArray, Header, SetBoolRequest, SuccessResponse, Time, from_cdr, to_cdr};
use std::time::Duration;

/// Longest time that a request waits for the session: a large map takes seconds to load or save.
const TIMEOUT: Duration = Duration::from_secs(20);

/// The reply of the services of `splatseg_msgs`.
#[derive(Serialize)]
struct Objects {
    success: bool,
    message: String,
    objects: Detection3dArray,
}

/// The request of `splatseg_msgs/srv/GetObject`.
#[derive(Deserialize)]
struct Id {
    id: i64,
}

/// The request of `splatseg_msgs/srv/FindObjects`.
#[derive(Deserialize)]
struct Text {
    text: String,
}

/// Offers all services of a node with a full name.
pub(crate) fn services(endpoints: &Endpoints, node: &str, requests: &Requests) -> Result<Vec<Service>, Ros2Error> {
    const TRIGGER: &str = "std_srvs/srv/Trigger";
    let offered: [(&str, &str, Answer); 7] = [
        ("save", TRIGGER, trigger(requests, LiveRequest::Save)),
        ("load", TRIGGER, trigger(requests, LiveRequest::Load(None))),
        ("reset", TRIGGER, trigger(requests, LiveRequest::Reset)),
        ("pause", "std_srvs/srv/SetBool", pause(requests)),
        ("list_objects", "splatseg_msgs/srv/ListObjects", list(requests)),
        ("get_object", "splatseg_msgs/srv/GetObject", get(requests)),
        ("find_objects", "splatseg_msgs/srv/FindObjects", find(requests)),
    ];
    let service = |(name, type_name, answer)| Service::new(endpoints, &format!("{node}/{name}"), type_name, answer);
    offered.into_iter().map(service).collect()
}

fn trigger(requests: &Requests, request: LiveRequest) -> Answer {
    let requests = requests.clone();
    Box::new(move |_| to_cdr(&done(requests.send(request.clone(), TIMEOUT))))
}

fn pause(requests: &Requests) -> Answer {
    let requests = requests.clone();
    Box::new(move |request| {
        let SetBoolRequest { data } = from_cdr(request)?;
        to_cdr(&done(requests.send(LiveRequest::Pause(data), TIMEOUT)))
    })
}

fn done(result: Result<String, String>) -> SuccessResponse {
    let success = result.is_ok();
    SuccessResponse { success, message: result.unwrap_or_else(|error| error) }
}

fn list(requests: &Requests) -> Answer {
    let requests = requests.clone();
    Box::new(move |_| to_cdr(&objects(&requests, |_| Object::counts)))
}

fn get(requests: &Requests) -> Answer {
    let requests = requests.clone();
    Box::new(move |request| {
        let Id { id } = from_cdr(request)?;
        let mut found = objects(&requests, move |_| move |object: &Object| i64::from(object.id) == id);
        // Of the services, only this one asks for an object that there must be.
        if found.success && found.objects.detections.is_empty() {
            (found.success, found.message) = (false, "no such object".to_owned());
        }
        to_cdr(&found)
    })
}

fn find(requests: &Requests) -> Answer {
    let requests = requests.clone();
    Box::new(move |request| {
        let Text { text } = from_cdr(request)?;
        let found = requests.look(LiveSession::words, TIMEOUT).and_then(|words| {
            let found = words.find(&text).map_err(|error| error.to_string())?;
            Ok(words.detections(&found))
        });
        to_cdr(&reply(found))
    })
}

/// The objects that are chosen between two frames.
fn objects<C: Fn(&Object) -> bool>(
    requests: &Requests,
    choose: impl FnOnce(&LiveSession) -> C + Send + 'static,
) -> Objects {
    reply(requests.look(move |session| session.detections(choose(session)), TIMEOUT))
}

fn reply(objects: Result<Detection3dArray, String>) -> Objects {
    let nothing = || Detection3dArray {
        header: Header { stamp: Time::from_nanoseconds(0), frame_id: String::new() },
        detections: Vec::new(),
    };
    match objects {
        Ok(objects) => Objects { success: true, message: format!("{} objects", objects.detections.len()), objects },
        Err(message) => Objects { success: false, message, objects: nothing() },
    }
}
