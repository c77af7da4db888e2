//! Bare hops of the same rate, payload and wake-up: one over the shared memory layer alone, a Unix socket, a pipe.
//!
//! One process sends, each message at a phase of its own within the period of the IMU, so that no two hops of one instant
//! compete; threads of the measuring process receive, one a means, each asleep until its message comes.

use std::io::{ErrorKind, PipeReader, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use ilns_bus::{BARE_BYTES, BareMessage, Bus, Prefix, WAIT};
use ilns_runtime::{Latency, ProcessArgs, StartClock, monotonic_now};
use rustix::fs::{OFlags, fcntl_setfl};
use shared_types::Process;

use super::{LatencyError, Outcome, Window, joined};

/// Name of the sending subcommand.
pub const SENDER: &str = "reference-sender";

/// What the sending process is told.
#[derive(Debug, clap::Args)]
pub struct SenderArgs {
    #[command(flatten)]
    process: ProcessArgs,
    /// Messages per second and means.
    #[arg(long, value_name = "HZ")]
    rate: u32,
}

/// What came over one means.
#[derive(Debug)]
pub(super) struct Hop {
    pub(super) latency: Latency,
    /// Missing by sequence number.
    pub(super) lost: u64,
    next: Option<u64>,
}

impl Hop {
    fn new() -> Hop {
        Hop { latency: Latency::precise(), lost: 0, next: None }
    }

    fn enter(&mut self, message: &BareMessage, received: i64, window: &Window) {
        if let Some(next) = self.next.replace(message.sequence + 1) {
            self.lost += message.sequence.saturating_sub(next);
        }
        if window.holds(message.t_published) {
            self.latency.record(received - message.t_published);
        }
    }
}

/// What came over each means.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) iceoryx2: Hop,
    pub(super) unix_socket: Hop,
    pub(super) pipe: Hop,
}

type Receiver = JoinHandle<Result<Hop, String>>;

/// The bare hops at work.
#[derive(Debug)]
pub(super) struct References {
    sender: Child,
    iceoryx2: Receiver,
    unix_socket: Receiver,
    pipe: Receiver,
}

impl References {
    /// Starts the receiving threads, then the sending process, whose ends are its standard input (the socket) and output
    /// (the pipe). Call from the main thread.
    pub(super) fn start(
        prefix: &Prefix,
        clock: &StartClock,
        rate: u32,
        window: &Arc<Window>,
    ) -> Result<References, Box<dyn std::error::Error>> {
        let (pipe_out, pipe_in) = std::io::pipe()?;
        let (socket_out, socket_in) = UnixDatagram::pair()?;
        socket_out.set_read_timeout(Some(WAIT))?;
        // A full queue is a loss of the receiver, not a halt of the sender.
        fcntl_setfl(&pipe_in, OFlags::NONBLOCK)?;
        fcntl_setfl(&socket_in, OFlags::NONBLOCK)?;
        let there = prefix.clone();
        let iceoryx2 = spawn(window, move |window| receive_iceoryx2(&there, window));
        let unix_socket = spawn(window, move |window| receive_socket(&socket_out, window));
        let pipe = spawn(window, move |window| receive_pipe(pipe_out, window));
        let sender = Command::new(std::env::current_exe()?)
            .arg(SENDER)
            .args(["--prefix", prefix.name(), "--rate", &rate.to_string(), "--start", &clock.to_string()])
            .args(["--supervisor", &std::process::id().to_string()])
            .stdin(Stdio::from(OwnedFd::from(socket_in)))
            .stdout(Stdio::from(OwnedFd::from(pipe_in)))
            .spawn()?;
        Ok(References { sender, iceoryx2, unix_socket, pipe })
    }

    /// What came, once the window is closed.
    pub(super) fn finish(mut self) -> Result<Measured, LatencyError> {
        // The pipe's end is what wakes its reader for the last time.
        let _ = self.sender.kill();
        let _ = self.sender.wait();
        let (iceoryx2, unix_socket, pipe) = (joined(self.iceoryx2), joined(self.unix_socket), joined(self.pipe));
        Ok(Measured { iceoryx2: iceoryx2?, unix_socket: unix_socket?, pipe: pipe? })
    }
}

fn spawn(window: &Arc<Window>, receive: impl FnOnce(&Window) -> Result<Hop, String> + Send + 'static) -> Receiver {
    let window = Arc::clone(window);
    thread::spawn(move || receive(&window))
}

fn receive_iceoryx2(prefix: &Prefix, window: &Window) -> Result<Hop, String> {
    let bus = Bus::join(prefix, Process::Monitor, 0).map_err(|error| error.to_string())?;
    let receiver = bus.bare_receiver().map_err(|error| error.to_string())?;
    let mut hop = Hop::new();
    while !window.is_closed() {
        receiver.wait_for(WAIT);
        while let Some(message) = receiver.receive() {
            hop.enter(&message, monotonic_now(), window);
        }
    }
    Ok(hop)
}

fn receive_socket(socket: &UnixDatagram, window: &Window) -> Result<Hop, String> {
    let mut hop = Hop::new();
    let mut bytes = [0; BARE_BYTES];
    while !window.is_closed() {
        match socket.recv(&mut bytes) {
            Ok(BARE_BYTES) => hop.enter(&BareMessage::from_bytes(&bytes), monotonic_now(), window),
            Ok(_) => return Err("a datagram of another size came".to_owned()),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(error) => return Err(error.to_string()),
        }
    }
    Ok(hop)
}

fn receive_pipe(mut pipe: PipeReader, window: &Window) -> Result<Hop, String> {
    let mut hop = Hop::new();
    let mut bytes = [0; BARE_BYTES];
    loop {
        match pipe.read_exact(&mut bytes) {
            Ok(()) => hop.enter(&BareMessage::from_bytes(&bytes), monotonic_now(), window),
            // The sender has ended.
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(hop),
            Err(error) => return Err(error.to_string()),
        }
    }
}

/// Sends over each means once a period until told to stop.
pub(super) fn send(args: &SenderArgs) -> Outcome {
    let shutdown = args.process.begin()?;
    let bus = Bus::join(&Prefix::new(&args.process.prefix)?, Process::Monitor, 0)?;
    let sender = bus.bare_sender()?;
    let period = 1_000_000_000 / i64::from(args.rate);
    let begun = args.process.start.map_or_else(monotonic_now, |start| start.mono);
    let (socket, pipe) = (rustix::stdio::stdin(), rustix::stdio::stdout());
    for sequence in 0.. {
        let t = begun + sequence as i64 * period;
        for (phase, means) in [Means::Iceoryx2, Means::Socket, Means::Pipe].into_iter().enumerate() {
            if !shutdown.sleep_until(t + (phase as i64 + 1) * period / 4) {
                return Ok(());
            }
            let message = BareMessage::new(sequence, monotonic_now());
            // What is refused is missing in the sequence, and counted there.
            let _sent = match means {
                Means::Iceoryx2 => sender.send(message),
                Means::Socket => rustix::io::write(socket.as_fd(), &message.to_bytes()).is_ok(),
                Means::Pipe => rustix::io::write(pipe.as_fd(), &message.to_bytes()).is_ok(),
            };
        }
    }
    Ok(())
}

enum Means {
    Iceoryx2,
    Socket,
    Pipe,
}
