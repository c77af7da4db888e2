//! The real executable and its processes, from outside.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{
    Pid, Signal, WaitOptions, getpid, kill_process, set_child_subreaper, test_kill_process, waitpid,
};
use serde_json::Value;
use shared_types::Time;

pub const ILNS: &str = env!("CARGO_BIN_EXE_ilns");

/// From the request to stop to its end.
pub const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Generous: a machine under load starts slowly.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// A set under a prefix that no other test has; whatever happens, it is stopped and its leftovers are removed.
pub struct Set {
    pub prefix: String,
    pub child: Child,
}

impl Set {
    pub fn start(test: &str, arguments: &[&str]) -> Set {
        let prefix = format!("s{}-{test}", std::process::id());
        let (command, rest) = arguments.split_first().expect("a subcommand");
        let child = Command::new(ILNS)
            .args([*command, "--prefix", prefix.as_str()])
            .args(rest)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the executable was built");
        Set { prefix, child }
    }

    pub fn signal(&self, signal: Signal) {
        kill(self.child.id(), signal);
    }

    /// Waits for its end: exit code, standard error, how long it took.
    pub fn end(&mut self, limit: Duration) -> (Option<i32>, String) {
        let code = self.child_code(limit);
        (code, self.errors())
    }

    /// What an ended one has said on standard error, unless somebody else has taken it.
    fn errors(&mut self) -> String {
        let mut errors = String::new();
        if let Some(mut pipe) = self.child.stderr.take() {
            std::io::Read::read_to_string(&mut pipe, &mut errors).expect("text");
        }
        errors
    }

    /// Waits for its end: exit code. For those who have taken its standard error.
    pub fn child_code(&mut self, limit: Duration) -> Option<i32> {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("our own child") {
                return status.code();
            }
            assert!(begun.elapsed() < limit, "it did not end within {limit:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// `ilns status --json` of this set, once it satisfies `wanted`.
    pub fn status_when(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().expect("our own child") {
                panic!("{what}: it ended before, {status}: {}", self.errors());
            }
            let output = ilns(&["status", "--json", "--prefix", &self.prefix]);
            let status: Option<Value> = serde_json::from_slice(&output.stdout).ok();
            match status {
                Some(status) if wanted(&status) => return status,
                last => assert!(Instant::now() < deadline, "{what}: not within {PATIENCE:?}; last: {last:?}"),
            }
        }
    }
}

impl Drop for Set {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        for path in leftovers(&self.prefix) {
            let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        }
    }
}

/// Holds the `estimate.csv` of a replay against the one that was `published`, row by row to the last bit, wherever they
/// have a time in common; how many that are.
pub fn assert_repeated(published: &Path, repeated: &Path) -> usize {
    let read = |path: &Path| std::fs::read_to_string(path).expect("it was written");
    let (published, repeated) = (read(published), read(repeated));
    let mut repeated_rows = repeated.lines().skip(1).peekable();
    let time = |line: &str| Time::parse(line.split(',').next().unwrap_or_default().as_bytes()).expect("a time");
    let (mut compared, mut differing) = (0, Vec::new());
    for row in published.lines().skip(1) {
        while repeated_rows.next_if(|other| time(other) < time(row)).is_some() {}
        if let Some(other) = repeated_rows.next_if(|other| time(other) == time(row)) {
            compared += 1;
            if other != row {
                differing.push((row.to_owned(), other.to_owned()));
            }
        }
    }
    assert!(differing.is_empty(), "{} of {compared} differ, the first:\n{:#?}", differing.len(), differing.first());
    compared
}

/// Where `child` says that its page is; what it says afterwards is passed on.
pub fn page_of(child: &mut Child) -> String {
    let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    let url = loop {
        let line = lines.next().expect("it says where its page is").expect("text");
        if let Some((_, rest)) = line.split_once("page at ") {
            break rest.split_whitespace().next().expect("an address").to_owned();
        }
    };
    std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| eprintln!("{line}")));
    url
}

pub fn ilns(arguments: &[&str]) -> Output {
    Command::new(ILNS).args(arguments).output().expect("the executable was built")
}

pub fn kill(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(pid as i32).expect("a process number");
    kill_process(pid, signal).expect("it lives");
}

/// Whether it runs; a dead one that came to this process as its child is buried.
pub fn lives(pid: u32) -> bool {
    let pid = Pid::from_raw(pid as i32).expect("a process number");
    let _ = waitpid(Some(pid), WaitOptions::NOHANG);
    test_kill_process(pid).is_ok()
}

/// Makes this process the parent of whatever its children leave behind. Left to another session, a *stopped* process
/// whose supervisor dies would be hung up and continued by the kernel at once: its process group is an orphan then.
pub fn adopt_orphans() {
    set_child_subreaper(Some(getpid())).expect("a process may adopt what its children leave");
}

/// Everything on this machine that bears the name of the set.
pub fn leftovers(prefix: &str) -> Vec<PathBuf> {
    let of = |directory: &Path| {
        let entries = std::fs::read_dir(directory).expect("readable");
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let bears_it = |path: &PathBuf| path.to_string_lossy().contains(&format!("ilns-{prefix}"));
        paths.filter(bears_it).collect::<Vec<PathBuf>>()
    };
    [of(Path::new("/dev/shm")), of(Path::new("/tmp"))].concat()
}

pub fn assert_nothing_left(prefix: &str) {
    assert_eq!(leftovers(prefix), Vec::<PathBuf>::new());
}

/// Messages per second on a channel.
pub fn channel_rate(status: &Value, channel: &str) -> f64 {
    let channels = status["channels"].as_array().expect("a list");
    let row = channels.iter().find(|row| row["name"] == channel);
    row.and_then(|row| row["rate"].as_f64()).unwrap_or(0.0)
}

pub fn process<'a>(status: &'a Value, name: &str) -> &'a Value {
    let processes = status["processes"].as_array().expect("a list");
    processes.iter().find(|process| process["name"] == name).unwrap_or(&Value::Null)
}
