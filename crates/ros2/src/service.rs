//! Services: requests and replies over DDS, as `rmw_fastrtps` maps them. The identity of a request is beside its content
//! (DDS-RPC 1.0, "enhanced" mapping); `rmw_cyclonedds` has another mapping and cannot call them.

use crate::Ros2Error;
use crate::endpoints::{Endpoints, Quality, Reader, Writer};
use crate::names::{dds_service, dds_type};
use crate::raw_cdr::RawCdr;
use rustdds::no_key::DeserializedCacheChange;
use rustdds::{SampleIdentity, SequenceNumber, WriteOptionsBuilder};
use splatseg_ros::CdrError;
use std::task::Waker;

/// Makes the reply to a request, both in CDR.
pub(crate) type Answer = Box<dyn FnMut(&[u8]) -> Result<Vec<u8>, CdrError> + Send>;

/// A service.
pub(crate) struct Service {
    name: String,
    requests: Reader,
    replies: Writer,
    answer: Answer,
}

impl Service {
    /// Offers a service with a full name and a type, e.g. `std_srvs/srv/Trigger`.
    pub(crate) fn new(endpoints: &Endpoints, name: &str, type_name: &str, answer: Answer) -> Result<Self, Ros2Error> {
        let [requests, replies] = dds_service(name);
        let dds_type = dds_type(type_name);
        let part = |part: &str| format!("{dds_type}{part}_");
        let requests = endpoints.dds_reader(requests, part("Request"), Quality::RELIABLE)?;
        let replies = endpoints.dds_writer(replies, part("Response"), Quality::RELIABLE)?;
        Ok(Self { name: name.to_owned(), requests, replies, answer })
    }

    /// Answers the requests that have arrived. Those that cannot be read get no reply, as in other nodes.
    pub(crate) fn answer(&mut self, waker: &Waker) {
        self.requests.set_waker(Some(waker.clone()));
        self.requests.drain_read_notifications();
        loop {
            let request = match self.requests.try_take_one() {
                Ok(Some(request)) => request,
                Ok(None) => break,
                Err(error) => {
                    tracing::debug!("{}: {error}", self.name);
                    continue;
                }
            };
            let identity = identity(&request);
            match (self.answer)(&request.into_value().0) {
                Ok(reply) => {
                    let options = WriteOptionsBuilder::new().related_sample_identity(identity).build();
                    if let Err(error) = self.replies.write_with_options(RawCdr(reply), options) {
                        tracing::warn!("{}: {error}", self.name);
                    }
                }
                Err(error) => tracing::warn!("{}: {error}", self.name),
            }
        }
    }
}

/// Returns the identity that the reply has to name. Fast DDS names the client's reader in it, and leaves the number
/// unknown.
fn identity(request: &DeserializedCacheChange<RawCdr>) -> SampleIdentity {
    let own = SampleIdentity { writer_guid: request.writer_guid(), sequence_number: request.sequence_number };
    match request.related_sample_identity() {
        Some(named) if named.sequence_number == SequenceNumber::UNKNOWN => {
            SampleIdentity { sequence_number: own.sequence_number, ..named }
        }
        Some(named) => named,
        None => own,
    }
}
