//! The page in a real browser: live, of a finished run, and as a file that was sent on. Pictures stay in `target/tmp/page`.

mod chromium;
#[expect(dead_code, reason = "another test file uses the other parts")]
#[path = "../harness/mod.rs"]
mod harness;

use std::path::Path;
use std::process::{Child, Command, Stdio};

use chromium::Chromium;
use harness::{ILNS, PATIENCE, Set, assert_nothing_left, ilns, kill, page_of, process};
use rustix::process::Signal;

const DESKTOP: (u32, u32) = (1440, 1000);
const PHONE: (u32, u32) = (390, 844);

fn assert_nothing_complained_of(browser: &Chromium) {
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
}

/// Nothing is cut off on the right once the page has taken note of the screen's size: tables that are too wide scroll by
/// themselves.
fn assert_fits(browser: &mut Chromium) {
    browser.wait_until("document.documentElement.scrollWidth <= window.innerWidth");
}

#[test]
fn a_live_run_is_seen_in_the_browser() {
    let Some(mut browser) = Chromium::start() else { return };
    let arguments = ["run", "--web", "127.0.0.1:0", "--scenario", "mission", "--preset", "realistic", "--rate", "4"];
    let fault = ["--fault", "dvl.blackout@45..60"];
    let mut set = Set::start("page", &[&arguments[..], &fault].concat());
    let url = page_of(&mut set.child);
    browser.open(&url, DESKTOP);

    // From the first second, whatever the mode.
    browser.wait_until("document.getElementById('link').dataset.link === 'live'");
    browser.wait_until("document.getElementById('mode').textContent !== 'no estimate'");
    browser.wait_until("ilns.store.point()?.e != null");
    let place = browser.value("document.getElementById('where').textContent");
    browser.wait_until(&format!("document.getElementById('where').textContent !== {place}"));
    browser.wait_until("document.querySelectorAll('#sensors tr[data-sensor=dvl][data-state=heard]').length === 1");

    // The outage turns the row, and is an event.
    browser.wait_until("document.querySelectorAll('#sensors tr[data-sensor=dvl][data-state=silent]').length === 1");
    browser.wait_until("document.getElementById('events').textContent.includes('dvl is silent')");
    browser.picture("live_desktop");

    // A chosen keyframe shows its factors, and stays chosen while the window moves on.
    browser.wait_until("document.querySelectorAll('#window .cell').length > 10");
    browser.click("#window .cell:nth-last-child(6)");
    let chosen = browser.value("document.querySelector('#window .cell[aria-selected=true]').dataset.t");
    browser.wait_until("document.querySelectorAll('#factors tbody tr[data-sensor=lbl]').length >= 3");
    let listed = browser.value("document.querySelectorAll('#factors tbody tr').length");
    let held = browser.value(&format!("ilns.store.keyframes.find((k) => k.t === Number({chosen})).factors.length"));
    assert_eq!(listed, held, "every factor is listed");
    browser.wait_until(&format!(
        "(() => {{ const cells = [...document.querySelectorAll('#window .cell')];
           const place = cells.findIndex((cell) => cell.getAttribute('aria-selected') === 'true');
           return cells.length - place >= 8 && cells[place].dataset.t === '{}'; }})()",
        chosen.as_str().expect("a time as text")
    ));

    // A late page has the past.
    browser.open(&url, PHONE);
    browser.prefer("dark");
    browser.wait_until("ilns.store.track.t.length > 100 && ilns.store.keyframes.length > 20");
    browser.wait_until("document.querySelectorAll('#sensors tr[data-sensor=dvl][data-state=heard]').length === 1");
    assert_fits(&mut browser);
    browser.picture("live_phone_dark");
    assert_nothing_complained_of(&browser);

    // A monitor that is killed comes back, and the page by itself finds it again.
    let before = set.status_when("the monitor runs", |status| process(status, "monitor")["state"] == "running");
    kill(process(&before, "monitor")["pid"].as_u64().expect("a number") as u32, Signal::KILL);
    set.status_when("the monitor is back", |status| process(status, "monitor")["restarts"] == 1);
    let seen = browser.value("ilns.store.range()[1]");
    browser.wait_until(&format!(
        "ilns.store.range()[1] > {seen} + 4 && document.getElementById('link').dataset.link === 'live'"
    ));

    set.signal(Signal::TERM);
    assert_eq!(set.child_code(PATIENCE), Some(0));
    assert_nothing_left(&set.prefix);
}

/// Kills its child whatever happens.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Walks through a finished run with the keyboard and the slider.
fn walk_through(browser: &mut Chromium, url: &str, picture: &str) {
    browser.open(url, DESKTOP);
    browser.wait_until("document.getElementById('link').textContent === 'finished run'");
    browser.wait_until("document.querySelectorAll('#factors tbody tr').length > 0");
    let end = browser.value("ilns.store.moment()").as_f64().expect("a time");
    // Home on the slider: the beginning.
    browser.press("#slider", "Home", 36);
    browser.wait_until("document.getElementById('mode').textContent === 'INITIALISING'");
    let begin = browser.value("ilns.store.moment()").as_f64().expect("a time");
    assert!(begin < end - 10.0, "{begin} and {end}");
    let middle = (begin + 2.0 * end) / 3.0;
    browser.value(&format!(
        "(() => {{ const s = document.getElementById('slider'); s.value = {middle}; s.dispatchEvent(new Event('input')); }})()"
    ));
    browser.wait_until(&format!("Math.abs(Number(document.getElementById('t').textContent) - {middle}) < 1"));
    browser.wait_until(&format!("ilns.store.window().at(-1).t <= {middle} && ilns.store.shown().t <= {middle}"));
    browser.wait_until("document.querySelectorAll('#factors tbody tr[data-sensor=lbl]').length > 0");
    browser.picture(picture);
    // It plays by itself.
    browser.click("#play");
    browser.wait_until(&format!("ilns.store.moment() > {middle} + 2"));
    assert_nothing_complained_of(browser);
}

#[test]
fn a_finished_run_is_walked_through_served_and_from_one_file() {
    let Some(mut browser) = Chromium::start() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (log, file) = (folder.path().join("log"), folder.path().join("run.html"));
    let text = |path: &Path| path.to_str().expect("temporary paths are text").to_owned();
    let scenario = text(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/short.toml"));
    for arguments in [
        vec!["simulate".to_owned(), scenario, "--preset".into(), "realistic".into(), "--out".into(), text(&log)],
        vec!["view".to_owned(), text(&log), "--export".into(), text(&file)],
    ] {
        let output = ilns(&arguments.iter().map(String::as_str).collect::<Vec<&str>>());
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    walk_through(&mut browser, &format!("file://{}", text(&file)), "finished_one_file");

    let child = Command::new(ILNS)
        .args(["view", &text(&log), "--web", "127.0.0.1:0"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the executable was built");
    let mut server = Guarded(child);
    let url = page_of(&mut server.0);
    walk_through(&mut browser, &url, "finished_served");
    browser.resize(PHONE);
    assert_fits(&mut browser);
}
