//! The C header says of the estimate what Rust says of it, and the C consumer reads what is sent.

use std::io::Write;
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use shared_types::{Header, Message, Mode, NavEstimate};

fn deploy(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(file)
}

/// Compiles with every warning an error; `None` on a machine without a C compiler, which is told.
fn compile(source: &Path, program: &Path) -> Option<()> {
    let output = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wpadded", "-Werror", "-I"])
        .arg(deploy("include"))
        .arg(source)
        .arg("-o")
        .arg(program)
        .output();
    match output {
        Err(_) => eprintln!("skipped: cc is not on this machine"),
        Ok(output) => assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr)),
    }
    program.exists().then_some(())
}

macro_rules! offsets {
    ($type:ty, $name:literal: $($field:ident)*) => {
        [$( ($name, stringify!($field), offset_of!($type, $field)) ),*]
    };
}

#[test]
fn the_c_header_has_the_offsets_of_the_rust_message() {
    let fields = [
        offsets!(Header, "ilns_header": sequence epoch source schema t_valid t_arrival t_published origin_sequence
            origin_t_arrival)
        .as_slice(),
        offsets!(NavEstimate, "ilns_estimate": header solution t_keyframe position_enu velocity_enu q_enu_body
            accel_bias gyro_bias position_cov velocity_cov attitude_cov sigma_rpy lat_lon_h aiding_age mode reserved)
        .as_slice(),
    ]
    .concat();
    let asked: String = fields
        .iter()
        .map(|(name, field, _)| format!("    printf(\"{name}.{field} %zu\\n\", offsetof(struct {name}, {field}));\n"))
        .collect();
    let program = format!(
        "#include <stddef.h>\n#include <stdio.h>\n#include \"ilns_estimate.h\"\nint main(void) {{\n{asked}    \
         printf(\"size %zu schema %d\\n\", sizeof(struct ilns_estimate), ILNS_ESTIMATE_SCHEMA);\n    return 0;\n}}\n"
    );
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (source, binary) = (folder.path().join("offsets.c"), folder.path().join("offsets"));
    std::fs::write(&source, program).expect("writable");
    if compile(&source, &binary).is_none() {
        return;
    }
    let said = String::from_utf8(Command::new(binary).output().expect("it was compiled").stdout).expect("text");
    let mut expected: String = fields.iter().map(|(name, field, at)| format!("{name}.{field} {at}\n")).collect();
    expected += &format!("size {} schema {}\n", size_of::<NavEstimate>(), NavEstimate::SCHEMA);
    assert_eq!(said, expected);
}

#[expect(unsafe_code, reason = "the message is repr(C), of plain numbers and without padding")]
fn bytes_of(estimate: &NavEstimate) -> &[u8] {
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(estimate).cast(), size_of::<NavEstimate>()) }
}

#[test]
fn the_c_consumer_reads_what_is_sent_and_refuses_another_schema() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let binary = folder.path().join("consumer");
    if compile(&deploy("examples/consumer.c"), &binary).is_none() {
        return;
    }
    let estimate = |mode: Mode, schema: u16| NavEstimate {
        header: Header { schema, ..Header::default() },
        solution: 1,
        t_keyframe: 2,
        position_enu: [1.5, -2.25, -50.125],
        velocity_enu: [0.0; 3],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: [0.0; 6],
        velocity_cov: [0.0; 6],
        attitude_cov: [0.0; 6],
        sigma_rpy: [0.0; 3],
        lat_lon_h: [0.0; 3],
        aiding_age: [f64::INFINITY; 5],
        mode: mode as u32,
        reserved: 0,
    };
    let read = |estimates: &[NavEstimate]| {
        let mut consumer = Command::new(&binary)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it was compiled");
        let mut input = consumer.stdin.take().expect("piped");
        estimates.iter().for_each(|estimate| input.write_all(bytes_of(estimate)).expect("it reads"));
        drop(input);
        let output = consumer.wait_with_output().expect("it ends with its input");
        (output.status.code(), String::from_utf8(output.stdout).expect("text"))
    };
    let good = [estimate(Mode::Initialising, 1), estimate(Mode::Ok, 1), estimate(Mode::Invalid, 1)];
    let text = "no position\nmode 1: east 1.500 m, north -2.250 m, up -50.125 m\nno position\n";
    assert_eq!(read(&good), (Some(0), text.to_owned()));
    assert_eq!(read(&[estimate(Mode::Ok, 2)]), (Some(2), String::new()));
}
