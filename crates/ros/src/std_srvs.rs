//! `std_srvs`: requests and responses of its services.

use serde::{Deserialize, Serialize};

/// A request without fields, e.g. of `std_srvs/srv/Trigger`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EmptyRequest {
    /// A structure in IDL needs at least one member. Unused.
    pub structure_needs_at_least_one_member: u8,
}

/// The request of `std_srvs/srv/SetBool`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetBoolRequest {
    /// The value.
    pub data: bool,
}

/// The response of `std_srvs/srv/Trigger` and `std_srvs/srv/SetBool`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SuccessResponse {
    /// True if the service did what was requested.
    pub success: bool,
    /// Description of the result, or the error.
    pub message: String,
}
