//! Stands for Foxglove's server in a build that has none: there is never one.

use std::net::SocketAddr;

use shared_types::{Heartbeat, KeyframeReport, NavEstimate, RawReading, Truth};

use super::FoxgloveError;

/// No value of it exists.
#[derive(Debug)]
pub(super) enum Server {}

impl Server {
    pub(super) fn open(_: SocketAddr, _: &str) -> Result<Server, FoxgloveError> {
        Err(FoxgloveError::NotBuiltIn)
    }

    pub(super) fn address(&self) -> SocketAddr {
        match *self {}
    }

    pub(super) fn origin(&mut self, _: [f64; 3]) {
        match *self {}
    }

    pub(super) fn reading(&mut self, _: &RawReading) {
        match *self {}
    }

    pub(super) fn truth(&mut self, _: &Truth) {
        match *self {}
    }

    pub(super) fn report(&mut self, _: &KeyframeReport) {
        match *self {}
    }

    pub(super) fn estimate(&mut self, _: &NavEstimate) {
        match *self {}
    }

    pub(super) fn heartbeat(&mut self, _: &Heartbeat) {
        match *self {}
    }
}
