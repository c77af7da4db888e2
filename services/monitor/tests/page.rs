//! The page over real sockets: bad clients, slow ones, a hundred at a time, and a monitor that does not mind any of them.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use clap::Parser;
use ilns_bus::{Bus, Owner, Prefix, Publisher};
use ilns_monitor::{Args, run};
use shared_types::{Header, Mode, NavEstimate, Process, Time, channel};

const PATIENCE: Duration = Duration::from_secs(20);

#[derive(Parser)]
struct CommandLine {
    #[command(flatten)]
    args: Args,
}

/// A set of which only the channels live, somebody who says where the vehicle is, and a monitor with a page.
struct Set {
    estimates: Publisher<NavEstimate>,
    next: u64,
    monitor: Child,
    address: SocketAddr,
    _owner: Owner,
}

impl Set {
    fn new(test: &str, mode: Mode) -> Set {
        let prefix = Prefix::new(&format!("w{}-{test}", std::process::id())).expect("short enough");
        let owner = Owner::take(&prefix).expect("nobody else has it");
        let bus = Bus::join(&prefix, Process::Propagator, 0).expect("owned");
        let estimates = bus.publisher(&channel::ESTIMATE).expect("room for a sender");
        let mut monitor = Command::new(std::env::current_exe().expect("this test"))
            .args(["--ignored", "--exact", "role_monitor", "--nocapture"])
            .env("ILNS_TEST_ARGS", format!("--prefix {prefix} --view none --web 127.0.0.1:0"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a test can start itself");
        let mut lines = BufReader::new(monitor.stderr.take().expect("piped")).lines();
        let address = loop {
            let line = lines.next().expect("it says where the page is").expect("text");
            if let Some((_, address)) = line.split_once("page at http://") {
                break address.parse().expect("an address");
            }
        };
        // What it says later must not fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let mut set = Set { estimates, next: 0, monitor, address, _owner: owner };
        set.speak(mode);
        set
    }

    fn speak(&mut self, mode: Mode) {
        let t = 100.0 + self.next as f64 * 0.005;
        self.next += 1;
        self.estimates.publish(NavEstimate {
            header: Header::at(Time::from_seconds(t)),
            solution: 1,
            t_keyframe: 0,
            position_enu: [self.next as f64, -4.2, -50.02],
            velocity_enu: [0.0; 3],
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            accel_bias: [0.0; 3],
            gyro_bias: [0.0; 3],
            position_cov: [0.04, 0.0, 0.0, 0.04, 0.0, 0.01],
            velocity_cov: [0.0; 6],
            attitude_cov: [0.0; 6],
            sigma_rpy: [0.01; 3],
            lat_lon_h: [36.38, 127.36, -50.02],
            aiding_age: [f64::INFINITY; 5],
            mode: mode as u32,
            reserved: 0,
        });
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).expect("the page listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
        stream
    }

    /// Sends `head` as it is; everything that comes back until the end.
    fn exchange(&self, head: &[u8]) -> String {
        let mut stream = self.connect();
        stream.write_all(head).expect("it takes what comes");
        let mut answer = Vec::new();
        match stream.read_to_end(&mut answer) {
            // A refused request may be answered before it was read whole.
            Ok(_) => {}
            Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}"),
        }
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn get(&self, path: &str) -> String {
        self.exchange(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").as_bytes())
    }

    /// A listener on the stream, after its first event.
    fn listen(&self) -> BufReader<TcpStream> {
        let mut stream = self.connect();
        stream.write_all(b"GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("it takes what comes");
        let mut stream = BufReader::new(stream);
        next_event(&mut stream, "state");
        stream
    }

    fn resident_bytes(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.monitor.id())).expect("it lives");
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).expect("a line of it");
        1024 * line.split_whitespace().nth(1).expect("a number").parse::<u64>().expect("a number")
    }
}

impl Drop for Set {
    fn drop(&mut self) {
        let _ = self.monitor.kill();
        let _ = self.monitor.wait();
    }
}

/// Reads on until an event of that name begins.
fn next_event(stream: &mut BufReader<TcpStream>, name: &str) {
    let mut line = String::new();
    while line.trim_end() != format!("event: {name}") {
        line.clear();
        assert!(stream.read_line(&mut line).expect("the stream goes on") > 0, "the stream has ended");
    }
}

#[test]
#[ignore = "the part of another process, started by other tests"]
fn role_monitor() {
    let Ok(words) = std::env::var("ILNS_TEST_ARGS") else { return };
    let words: Vec<&str> = ["monitor"].into_iter().chain(words.split_whitespace()).collect();
    std::process::exit(i32::from(run(&CommandLine::parse_from(words).args).is_err()));
}

#[test]
fn the_stream_sends_five_events_a_second_while_initialising_and_when_nothing_comes_any_more() {
    let set = Set::new("rate", Mode::Initialising);
    let mut stream = set.listen();
    let begun = Instant::now();
    (0..30).for_each(|_| next_event(&mut stream, "look"));
    // Ten a second are sent; on a machine under load half of them still are.
    assert!(begun.elapsed() < PATIENCE, "{:?}", begun.elapsed());
    assert!(set.get("/api/v1/snapshot").contains("\"mode\":\"INITIALISING\""));
}

#[test]
fn what_is_no_request_is_refused_and_the_page_goes_on() {
    let set = Set::new("malformed", Mode::Ok);
    let long = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "x".repeat(200_000));
    let many = format!("GET / HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "A: b\r\n".repeat(500));
    let bad: [&[u8]; 8] = [
        b"nonsense\r\n\r\n",
        b"GET / HTTP/9.9\r\nHost: localhost\r\n\r\n",
        b"GET nowhere HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost : localhost\r\n\r\n",
        long.as_bytes(),
        many.as_bytes(),
    ];
    for head in bad {
        let answer = set.exchange(head);
        let status: &str = answer.get(9..12).unwrap_or("");
        let shown = String::from_utf8_lossy(&head[..head.len().min(40)]);
        assert!(answer.is_empty() || status.starts_with('4'), "{shown:?}: {answer:.100}");
    }
    for path in ["/../../etc/passwd", "/assets/../../Cargo.toml", "/assets/%2e%2e%2f%2e%2e%2fCargo.toml"] {
        assert!(set.get(path).starts_with("HTTP/1.1 404"), "{path}");
    }
    let foreign = set.exchange(b"GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n");
    assert!(foreign.starts_with("HTTP/1.1 403") && !foreign.contains("<html"), "{foreign}");
    assert!(set.get("/healthz").starts_with("HTTP/1.1 200"));
}

#[test]
fn a_hundred_listeners_a_closed_one_and_silent_ones_leave_the_others_and_the_memory_alone() {
    let mut set = Set::new("hundred", Mode::Ok);
    let before = set.resident_bytes();
    let mut streams: Vec<BufReader<TcpStream>> = (0..100).map(|_| set.listen()).collect();
    // Ten go away in the middle, ten never read again, five never finish their request.
    streams.drain(..10);
    let silent: Vec<BufReader<TcpStream>> = streams.drain(..10).collect();
    let unfinished: Vec<TcpStream> = (0..5)
        .map(|_| {
            let mut stream = set.connect();
            stream.write_all(b"GET / HTTP/1.1\r\nHo").expect("it takes what comes");
            stream
        })
        .collect();
    for _ in 0..20 {
        set.speak(Mode::Ok);
        for stream in &mut streams {
            next_event(stream, "look");
        }
    }
    assert!(set.get("/api/v1/history").contains("\"kind\":\"live\""));
    assert!(set.get("/healthz").starts_with("HTTP/1.1 200"));
    let grown = set.resident_bytes().saturating_sub(before);
    assert!(grown < 60_000_000, "{grown} bytes more");
    drop((silent, unfinished));
}
