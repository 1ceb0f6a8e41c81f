//! `diagnostic_msgs`.

use crate::{Header, Interface, Message};
use serde::{Deserialize, Serialize};

message! {
    /// A value with its name (`diagnostic_msgs/msg/KeyValue`).
    KeyValue: Default, "diagnostic_msgs/msg/KeyValue", "string key\nstring value\n", [] {
        /// Its name.
        key: String,
        /// The value.
        value: String,
    }
}

message! {
    /// State of a part of a robot (`diagnostic_msgs/msg/DiagnosticStatus`).
    DiagnosticStatus: Default, "diagnostic_msgs/msg/DiagnosticStatus",
    "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n\
     string hardware_id\ndiagnostic_msgs/KeyValue[] values\n", [KeyValue] {
        /// [`Self::OK`], [`Self::WARN`], [`Self::ERROR`] or [`Self::STALE`].
        level: u8,
        /// Name of the part.
        name: String,
        /// The state in a sentence.
        message: String,
        /// Name of the hardware, if any.
        hardware_id: String,
        /// Details.
        values: Vec<KeyValue>,
    }
}

impl DiagnosticStatus {
    /// All is well.
    pub const OK: u8 = 0;
    /// Works, but not well.
    pub const WARN: u8 = 1;
    /// Does not work.
    pub const ERROR: u8 = 2;
    /// Nothing new is known.
    pub const STALE: u8 = 3;
}

message! {
    /// States of the parts of a robot (`diagnostic_msgs/msg/DiagnosticArray`).
    DiagnosticArray: Default, "diagnostic_msgs/msg/DiagnosticArray",
    "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n", [Header, DiagnosticStatus] {
        /// Time of the states.
        header: Header,
        /// The states.
        status: Vec<DiagnosticStatus>,
    }
}
