//! How the shared memory layer is set up: in code, never from a file that may lie about.

use iceoryx2::prelude::*;
use shared_types::{Channel, Message};

use crate::error::BusError;
use crate::prefix::Prefix;

/// Processes that can have one channel open: the set twice over for restarts, and guests.
pub(crate) const NODES: usize = 40;

const LAYOUT: &str = "ilns.layout";
const SCHEMA: &str = "ilns.schema";

/// Opens a node under a prefix. Cleaning up after the dead is the owner's business alone and done when a child has died,
/// never in passing: it would cost the start of another process its time.
pub(crate) fn open_node(prefix: &Prefix) -> Result<Node<ipc::Service>, BusError> {
    // Its filter comes before that of `tracing`; its ordinary failures are at debug.
    set_log_level(LogLevel::Warn);
    let fault = |reason: &dyn core::fmt::Debug| BusError::layer("set up prefix", prefix.name(), reason);
    let root = prefix.layer_directory();
    let root = root.to_str().ok_or_else(|| fault(&"the root path is not UTF-8"))?;
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.object_prefix().as_bytes()).map_err(|e| fault(&e))?;
    config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|e| fault(&e))?);
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| fault(&e))
}

/// Name of a service, as the layer wants it.
pub(crate) fn service_name(name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| BusError::layer("name channel", name, e))
}

fn attributes<T: Message>() -> [(&'static str, String); 2] {
    [(SCHEMA, T::SCHEMA.to_string()), (LAYOUT, format!("{:016x}", T::LAYOUT))]
}

/// What the creator of a channel states about its messages: the layer itself compares types by name and size only.
pub(crate) fn stated_layout<T: Message>(channel: &Channel<T>) -> Result<AttributeSpecifier, BusError> {
    let fault = |reason: &dyn core::fmt::Debug| BusError::layer("describe channel", channel.spec.name, reason);
    attributes::<T>().into_iter().try_fold(AttributeSpecifier::new(), |specifier, (key, value)| {
        let key = key.try_into().map_err(|e| fault(&e))?;
        let value = value.as_str().try_into().map_err(|e| fault(&e))?;
        specifier.define(&key, &value).map_err(|e| fault(&e))
    })
}

/// What a process that opens a channel expects of its messages.
pub(crate) fn expected_layout<T: Message>(channel: &Channel<T>) -> Result<AttributeVerifier, BusError> {
    let fault = |reason: &dyn core::fmt::Debug| BusError::layer("describe channel", channel.spec.name, reason);
    attributes::<T>().into_iter().try_fold(AttributeVerifier::new(), |verifier, (key, value)| {
        let key = key.try_into().map_err(|e| fault(&e))?;
        let value = value.as_str().try_into().map_err(|e| fault(&e))?;
        verifier.require(&key, &value).map_err(|e| fault(&e))
    })
}
