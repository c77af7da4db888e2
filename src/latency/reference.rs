//! Bare hops of the same rate, payload and wake-up: one over the shared memory layer alone, a Unix socket, a pipe.
//!
//! One process sends, each message at a phase of its own within the period of the IMU, so that no two hops of one instant
//! compete; threads of the measuring process receive, one a means, each asleep until its message comes, or, where the
//! propagator polls, one thread that looks after all three without end.

use std::io::{ErrorKind, PipeReader, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use ilns_bus::{BARE_BYTES, BareMessage, BareReceiver, Bus, Prefix, WAIT};
use ilns_runtime::{Latency, ProcessArgs, RealTime, StartClock, monotonic_now};
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

impl Measured {
    fn new() -> Measured {
        Measured { iceoryx2: Hop::new(), unix_socket: Hop::new(), pipe: Hop::new() }
    }
}

type Receiver = JoinHandle<Result<Measured, String>>;

/// The bare hops at work.
#[derive(Debug)]
pub(super) struct References {
    sender: Child,
    iceoryx2: Receiver,
    unix_socket: Option<Receiver>,
    pipe: Option<Receiver>,
}

impl References {
    /// Starts the receiving threads, then the sending process, whose ends are its standard input (the socket) and output
    /// (the pipe). Call from the main thread.
    pub(super) fn start(
        prefix: &Prefix,
        clock: &StartClock,
        rate: u32,
        processes: Option<&Path>,
        real_time: RealTime,
        window: &Arc<Window>,
    ) -> Result<References, Box<dyn std::error::Error>> {
        let (pipe_out, pipe_in) = std::io::pipe()?;
        let (socket_out, socket_in) = UnixDatagram::pair()?;
        // A full queue is a loss of the receiver, not a halt of the sender.
        fcntl_setfl(&pipe_in, OFlags::NONBLOCK)?;
        fcntl_setfl(&socket_in, OFlags::NONBLOCK)?;
        let (iceoryx2, unix_socket, pipe) = if real_time.polls() {
            fcntl_setfl(&pipe_out, OFlags::NONBLOCK)?;
            fcntl_setfl(&socket_out, OFlags::NONBLOCK)?;
            let there = prefix.clone();
            // At ordinary priority: above others, it would take their core from them.
            let all = spawn(window, None, move |window| poll_all(&there, socket_out, pipe_out, window));
            (all, None, None)
        } else {
            socket_out.set_read_timeout(Some(WAIT))?;
            let there = prefix.clone();
            let real_time = Some(real_time);
            let iceoryx2 = spawn(window, real_time, move |window| receive_iceoryx2(&there, window));
            let unix_socket = spawn(window, real_time, move |window| receive_socket(&socket_out, window));
            (iceoryx2, Some(unix_socket), Some(spawn(window, real_time, move |window| receive_pipe(pipe_out, window))))
        };
        let mut sender = Command::new(std::env::current_exe()?);
        sender
            .arg(SENDER)
            .args(["--prefix", prefix.name(), "--rate", &rate.to_string(), "--start", &clock.to_string()])
            .args(["--supervisor", &std::process::id().to_string(), "--log-level", "warn"])
            .stdin(Stdio::from(OwnedFd::from(socket_in)))
            .stdout(Stdio::from(OwnedFd::from(pipe_in)));
        if let Some(file) = processes {
            sender.arg("--processes").arg(file);
        }
        Ok(References { sender: sender.spawn()?, iceoryx2, unix_socket, pipe })
    }

    /// What came, once the window is closed.
    pub(super) fn finish(mut self) -> Result<Measured, LatencyError> {
        // The pipe's end is what wakes its reader for the last time.
        let _ = self.sender.kill();
        let _ = self.sender.wait();
        let (socket, pipe) = (self.unix_socket.map(joined), self.pipe.map(joined));
        let mut measured = joined(self.iceoryx2)?;
        if let Some(alone) = socket {
            measured.unix_socket = alone?.unix_socket;
        }
        if let Some(alone) = pipe {
            measured.pipe = alone?.pipe;
        }
        Ok(measured)
    }
}

fn spawn(
    window: &Arc<Window>,
    real_time: Option<RealTime>,
    receive: impl FnOnce(&Window) -> Result<Measured, String> + Send + 'static,
) -> Receiver {
    let window = Arc::clone(window);
    thread::spawn(move || {
        if let Some(real_time) = real_time {
            real_time.enter();
        }
        receive(&window)
    })
}

fn bare_receiver(prefix: &Prefix) -> Result<(Bus, BareReceiver), String> {
    let bus = Bus::join(prefix, Process::Monitor, 0).map_err(|error| error.to_string())?;
    let receiver = bus.bare_receiver().map_err(|error| error.to_string())?;
    Ok((bus, receiver))
}

fn receive_iceoryx2(prefix: &Prefix, window: &Window) -> Result<Measured, String> {
    let (_bus, receiver) = bare_receiver(prefix)?;
    let mut measured = Measured::new();
    while !window.is_closed() {
        receiver.wait_for(WAIT);
        take_all(&receiver, &mut measured, window);
    }
    Ok(measured)
}

fn receive_socket(socket: &UnixDatagram, window: &Window) -> Result<Measured, String> {
    let mut measured = Measured::new();
    while !window.is_closed() {
        take_datagram(socket, &mut measured, window)?;
    }
    Ok(measured)
}

fn receive_pipe(mut pipe: PipeReader, window: &Window) -> Result<Measured, String> {
    let mut measured = Measured::new();
    while take_from_pipe(&mut pipe, &mut measured, window)? {}
    Ok(measured)
}

/// One thread for the three of them: three pollers would take three cores.
fn poll_all(prefix: &Prefix, socket: UnixDatagram, mut pipe: PipeReader, window: &Window) -> Result<Measured, String> {
    let (_bus, receiver) = bare_receiver(prefix)?;
    let mut measured = Measured::new();
    while !window.is_closed() {
        take_all(&receiver, &mut measured, window);
        take_datagram(&socket, &mut measured, window)?;
        take_from_pipe(&mut pipe, &mut measured, window)?;
    }
    Ok(measured)
}

fn take_all(receiver: &BareReceiver, measured: &mut Measured, window: &Window) {
    while let Some(message) = receiver.receive() {
        measured.iceoryx2.enter(&message, monotonic_now(), window);
    }
}

/// A datagram, if one comes before the socket's time-out.
fn take_datagram(socket: &UnixDatagram, measured: &mut Measured, window: &Window) -> Result<(), String> {
    let mut bytes = [0; BARE_BYTES];
    match socket.recv(&mut bytes) {
        Ok(BARE_BYTES) => {
            let received = monotonic_now();
            measured.unix_socket.enter(&BareMessage::from_bytes(&bytes), received, window);
            Ok(())
        }
        Ok(_) => Err("a datagram of another size came".to_owned()),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(()),
        Err(error) => Err(error.to_string()),
    }
}

/// What stands in the pipe, which a write of so few bytes enters whole; false at its end.
fn take_from_pipe(pipe: &mut PipeReader, measured: &mut Measured, window: &Window) -> Result<bool, String> {
    let mut bytes = [0; BARE_BYTES];
    match pipe.read(&mut bytes) {
        Ok(BARE_BYTES) => {
            let received = monotonic_now();
            measured.pipe.enter(&BareMessage::from_bytes(&bytes), received, window);
            Ok(true)
        }
        Ok(0) => Ok(false),
        Ok(_) => Err("a part of a message came through the pipe".to_owned()),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(true),
        Err(error) => Err(error.to_string()),
    }
}

/// Sends over each means once a period until told to stop.
pub(super) fn send(args: &SenderArgs) -> Outcome {
    let shutdown = args.process.begin()?;
    let real_time = args.process.real_time(Process::EmulatorImu)?;
    let bus = Bus::join(&Prefix::new(&args.process.prefix)?, Process::Monitor, 0)?;
    let sender = bus.bare_sender()?;
    let period = 1_000_000_000 / i64::from(args.rate);
    let begun = args.process.start.map_or_else(monotonic_now, |start| start.mono);
    let (socket, pipe) = (rustix::stdio::stdin(), rustix::stdio::stdout());
    real_time.enter();
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
