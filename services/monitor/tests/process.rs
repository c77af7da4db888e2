//! The monitor as a process: what it prints, and how it ends. Each test has a prefix of its own.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel as pipe};
use std::time::{Duration, Instant};

use clap::Parser;
use ilns_bus::{Bus, Owner, Prefix, Publisher};
use ilns_monitor::{Args, MonitorError, run};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::{Header, Mode, NavEstimate, Process, ProcessState, Time, channel};

const PATIENCE: Duration = Duration::from_secs(20);

#[derive(Parser)]
struct CommandLine {
    #[command(flatten)]
    args: Args,
}

fn args(words: &[&str]) -> Args {
    CommandLine::parse_from([&["monitor"], words].concat()).args
}

/// A set of which only the channels live, and somebody who says where the vehicle is.
struct Set {
    prefix: Prefix,
    estimates: Publisher<NavEstimate>,
    next: u64,
    owner: Owner,
}

impl Set {
    fn new(test: &str) -> Set {
        let prefix = Prefix::new(&format!("m{}-{test}", std::process::id())).expect("short enough");
        let owner = Owner::take(&prefix).expect("nobody else has it");
        let bus = Bus::join(&prefix, Process::Propagator, 0).expect("owned");
        let estimates = bus.publisher(&channel::ESTIMATE).expect("room for a sender");
        Set { prefix, estimates, next: 0, owner }
    }

    fn speak(&mut self) {
        let t = 100.0 + self.next as f64 * 0.005;
        self.next += 1;
        self.estimates.publish(NavEstimate {
            header: Header::at(Time::from_seconds(t)),
            solution: 1,
            t_keyframe: 0,
            position_enu: [23.4, -4.2, -50.02],
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
            mode: Mode::Ok as u32,
            reserved: 0,
        });
    }

    /// Starts a monitor as a process of its own: the ignored test below.
    fn monitor(&self, words: &str) -> Guarded {
        let child = Command::new(std::env::current_exe().expect("this test"))
            .args(["--ignored", "--exact", "role_monitor"])
            .env("ILNS_TEST_ARGS", format!("--prefix {} {words}", self.prefix))
            .env_remove("NO_COLOR")
            .stdout(Stdio::piped())
            .spawn();
        Guarded(child.expect("a test can start itself"))
    }

    /// Speaks until `text` has been printed; everything printed so far.
    fn speak_until(&mut self, output: &Receiver<String>, text: &str) -> String {
        let deadline = Instant::now() + PATIENCE;
        let mut printed = String::new();
        while !printed.contains(text) {
            assert!(Instant::now() < deadline, "no {text:?} in {printed:?}");
            self.speak();
            if let Ok(more) = output.recv_timeout(Duration::from_millis(5)) {
                printed.push_str(&more);
            }
        }
        printed
    }
}

/// Kills its child whatever happens.
struct Guarded(Child);

impl Guarded {
    /// What it prints, as it comes.
    fn output(&mut self) -> Receiver<String> {
        let mut stdout = BufReader::new(self.0.stdout.take().expect("piped"));
        let (sender, receiver) = pipe();
        std::thread::spawn(move || {
            while let Ok(bytes) = stdout.fill_buf() {
                let count = bytes.len();
                if count == 0 || sender.send(String::from_utf8_lossy(bytes).into_owned()).is_err() {
                    return;
                }
                stdout.consume(count);
            }
        });
        receiver
    }

    fn terminate(&self) {
        let pid = Pid::from_raw(self.0.id() as i32).expect("a process has a number");
        kill_process(pid, Signal::TERM).expect("it lives");
    }

    /// Whether it succeeded.
    fn end(&mut self) -> bool {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.0.try_wait().expect("our child") {
                return status.success();
            }
            assert!(Instant::now() < deadline, "it does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "the part of another process, started by other tests"]
fn role_monitor() {
    let Ok(words) = std::env::var("ILNS_TEST_ARGS") else { return };
    let ended = run(&args(&words.split_whitespace().collect::<Vec<&str>>()));
    // The harness must not add its verdict to what the monitor prints.
    std::process::exit(i32::from(ended.is_err()));
}

#[test]
fn without_a_terminal_lines_are_printed_until_sigterm() {
    let mut set = Set::new("lines");
    let mut monitor = set.monitor("");
    let output = monitor.output();
    set.speak_until(&output, "OK E=23.400 N=-4.200 U=-50.020 m sE=0.200 sN=0.200 sU=0.100 m");
    monitor.terminate();
    assert!(monitor.end());
}

#[test]
fn a_terminal_is_given_back_at_sigterm() {
    let mut set = Set::new("terminal");
    let mut monitor = set.monitor("--view terminal");
    let output = monitor.output();
    let mut printed = set.speak_until(&output, "23.400");
    assert!(!printed.contains("\x1b[?1049l"), "it is not given back while it is in use");
    monitor.terminate();
    printed.extend(output.iter());
    assert!(monitor.end());
    let entered = printed.find("\x1b[?1049h\x1b[?25l").expect("the alternate screen");
    let left = printed.find("\x1b[?25h\x1b[?1049l").expect("the screen as it was");
    assert!(entered < left);
    assert!(printed[left..].contains("OK E=23.400"), "the last state stays: {:?}", &printed[left..]);
    assert!(!printed.contains("\x1b[31m") && !printed.contains("\x1b[32m"), "no colours in a pipe");
}

#[test]
fn one_look_prints_one_object_and_says_nothing_on_the_bus() {
    let mut set = Set::new("once");
    let bus = Bus::join(&set.prefix, Process::Recorder, 0).expect("owned");
    let mut health = bus.subscriber(&channel::HEALTH).expect("room");
    let mut monitor = set.monitor("--once --json");
    let output = monitor.output();
    let printed = set.speak_until(&output, "\"events\":[");
    assert!(monitor.end());
    let json = printed.lines().find(|line| line.starts_with('{')).expect("an object on a line");
    for part in [format!("\"prefix\":\"{}\"", set.prefix), "\"mode\":\"OK\"".into(), "\"lost\":0".into()] {
        assert!(json.contains(&part), "{part} in {json}");
    }
    assert!(health.receive().is_none());
}

#[test]
fn a_monitor_that_nobody_reads_ends_in_peace() {
    let mut set = Set::new("unread");
    let mut monitor = set.monitor("--view lines");
    let mut stdout = BufReader::new(monitor.0.stdout.take().expect("piped"));
    set.speak();
    let mut line = String::new();
    while !line.starts_with("t=") {
        line.clear();
        assert!(stdout.read_line(&mut line).expect("text") > 0, "it ended before it was left alone");
    }
    drop(stdout);
    assert!(monitor.end());
}

#[test]
fn its_heartbeat_tells_what_it_heard_and_that_it_stops() {
    let mut set = Set::new("health");
    let mut health = set.owner.bus().subscriber(&channel::HEALTH).expect("room");
    let monitor = set.monitor("--view none");
    let deadline = Instant::now() + PATIENCE;
    let mut wait_for = |state: ProcessState, handled: u64| {
        loop {
            assert!(Instant::now() < deadline, "no heartbeat that is {}", state.name());
            set.speak();
            std::thread::sleep(Duration::from_millis(5));
            let Some(beat) = health.newest() else { continue };
            assert_eq!((beat.process, beat.pid), (Process::Monitor as u32, monitor.0.id()));
            if beat.state == state as u32 && beat.handled >= handled {
                return;
            }
        }
    };
    wait_for(ProcessState::Running, 50);
    monitor.terminate();
    wait_for(ProcessState::Stopping, 50);
}

#[test]
fn without_a_set_it_says_so() {
    let error = run(&args(&["--prefix", "nobody-here", "--view", "none"])).expect_err("nobody owns the prefix");
    assert!(matches!(error, MonitorError::Bus(_)) && error.to_string().contains("nobody-here"), "{error}");
}
