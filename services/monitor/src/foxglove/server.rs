//! Foxglove's WebSocket server on a thread of its own.
//!
//! Messages are handed to a queue per client, which forgets its oldest when the client is slow: whoever hands them over never
//! waits. A channel that nobody has subscribed to costs the composing of its messages and nothing else.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

use ::foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer};
use ilns_recording::LogError;
use ilns_recording::mcap::{Composer, MessageSink, message_channels};
use shared_types::{Heartbeat, KeyframeReport, NavEstimate, Process, RawReading, Truth};
use tokio::sync::oneshot;

use super::FoxgloveError;

/// Messages that wait for a slow client: some five seconds.
const BACKLOG: usize = 512;

/// What the monitor does not hear.
const UNHEARD: [&str; 5] = ["/sensor/imu", "/sensor/dvl", "/sensor/mcp", "/sensor/ps", "/recorder/status"];

/// A server that goes on until it is dropped.
#[derive(Debug)]
pub(super) struct Server {
    composer: Composer,
    channels: Channels,
    /// The server knows its channels as long as this lives.
    _context: Arc<Context>,
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// Foxglove's channels by the numbers of ours.
#[derive(Debug)]
struct Channels(Vec<Option<Arc<RawChannel>>>);

impl MessageSink for Channels {
    fn put(&mut self, channel: usize, t_ns: i64, text: &[u8]) -> Result<(), LogError> {
        if let Some(Some(channel)) = self.0.get(channel) {
            channel.log_with_meta(text, PartialMetadata { log_time: Some(t_ns.max(0) as u64) });
        }
        Ok(())
    }
}

impl Server {
    pub(super) fn open(address: SocketAddr, set: &str) -> Result<Server, FoxgloveError> {
        let failed = |error: &dyn std::fmt::Display| FoxgloveError::Server(error.to_string());
        let context = Context::new();
        let channels = message_channels().into_iter().map(|ours| {
            if UNHEARD.contains(&ours.topic) {
                return Ok(None);
            }
            let schema = Schema::new(ours.schema_name, "jsonschema", ours.schema.into_bytes());
            let channel = ChannelBuilder::new(ours.topic).message_encoding("json").schema(schema).context(&context);
            channel.build_raw().map(Some)
        });
        let channels = Channels(channels.collect::<Result<_, _>>().map_err(|error| failed(&error))?);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| failed(&error))?;
        let server = WebSocketServer::new()
            .name(format!("ilns {set}"))
            .bind(address.ip().to_string(), address.port())
            .message_backlog_size(BACKLOG)
            .context(&context);
        let (begun, beginning) = channel();
        let (stop, stopped) = oneshot::channel();
        let serve = move || runtime.block_on(serve(server, &begun, stopped));
        let thread = std::thread::Builder::new().name("foxglove".to_owned()).spawn(serve);
        let thread = thread.map_err(|error| failed(&error))?;
        let port = beginning.recv().map_err(|error| failed(&error))?.map_err(|error| failed(&error))?;
        let address = SocketAddr::new(address.ip(), port);
        let (stop, thread) = (Some(stop), Some(thread));
        Ok(Server { composer: Composer::new(), channels, _context: context, address, stop, thread })
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    pub(super) fn origin(&mut self, origin: [f64; 3]) {
        self.compose(|composer, channels| composer.origin(origin, channels));
    }

    pub(super) fn reading(&mut self, reading: &RawReading) {
        self.compose(|composer, channels| composer.reading(reading, channels));
    }

    pub(super) fn truth(&mut self, truth: &Truth) {
        self.compose(|composer, channels| composer.truth(truth, channels));
    }

    pub(super) fn report(&mut self, report: &KeyframeReport) {
        self.compose(|composer, channels| composer.report(report, channels));
    }

    pub(super) fn estimate(&mut self, estimate: &NavEstimate) {
        self.compose(|composer, channels| composer.estimate(estimate, channels));
    }

    pub(super) fn heartbeat(&mut self, beat: &Heartbeat) {
        self.compose(|composer, channels| composer.heartbeat(beat, channels));
        // Whoever came late has not heard it, and the supervisor speaks twice a second.
        if beat.process == Process::Supervisor as u32 {
            self.compose(Composer::repeat_origin);
        }
    }

    fn compose(&mut self, compose: impl FnOnce(&mut Composer, &mut Channels) -> Result<(), LogError>) {
        // These channels refuse nothing.
        let _ = compose(&mut self.composer, &mut self.channels);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed.
            let _ = thread.join();
        }
    }
}

/// Serves until `stopped` comes, or its other end is gone.
async fn serve(
    server: WebSocketServer,
    begun: &Sender<Result<u16, ::foxglove::FoxgloveError>>,
    stopped: oneshot::Receiver<()>,
) {
    match server.start().await {
        Ok(handle) => {
            let _ = begun.send(Ok(handle.port()));
            let _ = stopped.await;
            // Clients are cut off and not waited for.
            drop(handle.stop());
        }
        Err(error) => {
            let _ = begun.send(Err(error));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;
    use std::time::{Duration, Instant};

    use serde_json::{Value, json};

    use super::*;
    use crate::testing::{ORIGIN, estimate_at, heartbeat, report_at};

    const PATIENCE: Duration = Duration::from_secs(20);

    /// A client as Foxglove is one: RFC 6455 by hand.
    struct Client(TcpStream);

    impl Client {
        fn connect(address: SocketAddr) -> Client {
            let mut stream = TcpStream::connect(address).expect("it listens");
            stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
            let head = format!(
                "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                 Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
            );
            stream.write_all(head.as_bytes()).expect("taken");
            let mut answer = Vec::new();
            while !answer.ends_with(b"\r\n\r\n") {
                let mut byte = [0];
                stream.read_exact(&mut byte).expect("an answer");
                answer.extend(byte);
            }
            assert!(answer.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&answer));
            Client(stream)
        }

        /// The next message: operation code and content.
        fn next(&mut self) -> (u8, Vec<u8>) {
            let mut head = [0; 2];
            self.0.read_exact(&mut head).expect("a frame");
            let length = match head[1] {
                126 => {
                    let mut length = [0; 2];
                    self.0.read_exact(&mut length).expect("a length");
                    usize::from(u16::from_be_bytes(length))
                }
                127 => {
                    let mut length = [0; 8];
                    self.0.read_exact(&mut length).expect("a length");
                    u64::from_be_bytes(length) as usize
                }
                length => usize::from(length),
            };
            let mut content = vec![0; length];
            self.0.read_exact(&mut content).expect("whole");
            (head[0] & 0x0f, content)
        }

        fn next_text(&mut self, op: &str) -> Value {
            loop {
                if let (1, content) = self.next() {
                    let message: Value = serde_json::from_slice(&content).expect("JSON");
                    if message["op"] == op {
                        return message;
                    }
                }
            }
        }

        /// The next message of a subscription: log time and content.
        fn next_of(&mut self, subscription: u32) -> (u64, Value) {
            loop {
                if let (2, content) = self.next()
                    && content[0] == 1
                    && content[1..5] == subscription.to_le_bytes()
                {
                    let log_time = u64::from_le_bytes(content[5..13].try_into().expect("eight bytes"));
                    return (log_time, serde_json::from_slice(&content[13..]).expect("JSON"));
                }
            }
        }

        fn say(&mut self, message: &Value) {
            let text = message.to_string();
            let mut frame = vec![0x81, 0x80 | 126];
            frame.extend(u16::try_from(text.len()).expect("short").to_be_bytes());
            // A mask of zeros is one.
            frame.extend([0; 4]);
            frame.extend(text.as_bytes());
            self.0.write_all(&frame).expect("taken");
        }
    }

    #[test]
    fn a_client_hears_poses_scene_origin_and_factors_and_can_change_nothing() {
        let mut server = Server::open("127.0.0.1:0".parse().expect("an address"), "main").expect("a free port");
        let mut client = Client::connect(server.address());
        let info = client.next_text("serverInfo");
        assert_eq!((&info["name"], &info["capabilities"]), (&json!("ilns main"), &json!([])));
        let mut channels: Vec<Value> = Vec::new();
        while channels.len() < 13 {
            channels.extend(client.next_text("advertise")["channels"].as_array().expect("a list").clone());
        }
        let id = |topic: &str| {
            let channel = channels.iter().find(|channel| channel["topic"] == topic);
            channel.unwrap_or_else(|| panic!("{topic} is not offered"))["id"].clone()
        };
        let topics = ["/pose", "/scene", "/nav/frame_origin", "/nav/diagnostics"];
        let wishes = topics.iter().enumerate().map(|(index, topic)| json!({"id": index, "channelId": id(topic)}));
        client.say(&json!({"op": "subscribe", "subscriptions": wishes.collect::<Vec<Value>>()}));

        let deadline = Instant::now() + PATIENCE;
        let numbers = message_channels();
        let number = |topic: &str| numbers.iter().position(|ours| ours.topic == topic).expect("one of ours");
        while !topics.iter().all(|topic| server.channels.0[number(topic)].as_ref().is_some_and(|one| one.has_sinks())) {
            assert!(Instant::now() < deadline, "the subscription is not heard");
            std::thread::yield_now();
        }

        server.origin(ORIGIN);
        server.estimate(&estimate_at(100.0, [1.0, 2.0, -3.0]));
        server.report(&report_at(100.0));
        assert_eq!(client.next_of(2).1["lat"], json!(ORIGIN[0]));
        let (t, pose) = client.next_of(0);
        assert_eq!((t, &pose["frame_id"]), (100_000_000_000, &json!("map")));
        assert_eq!(pose["timestamp"], json!({"sec": 100, "nsec": 0}));
        assert!(pose["pose"]["position"]["x"].is_number(), "{pose}");
        assert!(client.next_of(1).1["entities"].is_array());
        assert_eq!(client.next_of(3).1["factors"][4]["gate"][0], json!(0.0));
        server.heartbeat(&heartbeat(Process::Supervisor, 0));
        assert_eq!(client.next_of(2).1["h"], json!(ORIGIN[2]), "for those who come late");

        // Hours for a client that does not read: what it cannot take is forgotten, and nobody waits.
        for step in 1..20_000 {
            server.estimate(&estimate_at(100.0 + 0.1 * f64::from(step), [1.0, 2.0, -3.0]));
        }
        let mut newest = 0;
        while newest < 2_000_000_000_000 {
            newest = client.next_of(0).0;
        }
    }
}
