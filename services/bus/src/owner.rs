//! The owner of a prefix: locks it, wipes what a dead owner left, creates and holds every channel.

use std::any::Any;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use shared_types::{Channel, ChannelVisitor, Message, Overflow, Process, visit_channels};

use crate::bare::BareServices;
use crate::bells::Reader;
use crate::bus::Bus;
use crate::error::BusError;
use crate::prefix::Prefix;
use crate::settings::{NODES, service_name, stated_layout};

/// Where the operating system shows shared memory objects.
const SHARED_MEMORY: &str = "/dev/shm";

/// How long the processes of a dead owner may go on creating files, until they have heard of its death.
const LAST_BREATH: Duration = Duration::from_secs(2);

/// Senders that can ring one reader: every process of the set, twice over for restarts.
const RINGERS: usize = 32;

/// The one process that owns a prefix. Dropped or [closed](Owner::close), it leaves nothing behind; killed, the next owner
/// wipes what it left. Drop every port that was made from [`Owner::bus`] before.
#[derive(Debug)]
pub struct Owner {
    // Dropped in this order: the channels, the node that holds them, and last the lock.
    channels: Vec<Box<dyn Any>>,
    bus: Option<Bus>,
    prefix: Prefix,
    _lock: File,
}

impl Owner {
    /// Takes a prefix: locks it, wipes its leftovers, creates every channel of the table and every bell.
    ///
    /// # Errors
    /// [`BusError::InUse`] when somebody owns it, with his process number.
    pub fn take(prefix: &Prefix) -> Result<Owner, BusError> {
        let lock = lock(prefix)?;
        wipe(prefix, &[prefix.lock_file()])?;
        Owner::set_up(prefix, lock)
    }

    /// As [`Owner::take`], but the folder of the run stays as a killed owner left it: for a set that goes on in its place.
    ///
    /// # Errors
    /// As [`Owner::take`].
    pub fn take_over(prefix: &Prefix) -> Result<Owner, BusError> {
        let lock = lock(prefix)?;
        wipe(prefix, &[prefix.lock_file(), prefix.run_directory()])?;
        Owner::set_up(prefix, lock)
    }

    fn set_up(prefix: &Prefix, lock: File) -> Result<Owner, BusError> {
        let bus = Bus::enter(prefix, Process::Supervisor, 0)?;
        let mut creator = Creator { node: bus.node(), channels: Vec::new() };
        visit_channels(&mut creator)?;
        for reader in Reader::ALL {
            creator.create_bell(reader)?;
        }
        let channels = creator.channels;
        let ready = prefix.ready_file();
        fs::write(&ready, []).map_err(BusError::io("write", ready))?;
        Ok(Owner { channels, bus: Some(bus), prefix: prefix.clone(), _lock: lock })
    }

    /// The owner's own place on the bus, for its ports.
    pub fn bus(&self) -> &Bus {
        self.bus.as_ref().expect("only `drop` takes it")
    }

    /// Creates the bare hop that latencies are held against, beside the channels of the table.
    ///
    /// # Errors
    /// [`BusError::Layer`].
    pub fn offer_bare_hop(&mut self) -> Result<(), BusError> {
        let services = BareServices::create(self.bus().node())?;
        self.channels.push(Box::new(services));
        Ok(())
    }

    /// Gives back what dead processes held; call it after a child's death and before its restart. Returns how many dead
    /// processes were cleaned up after.
    pub fn cleanup_dead_nodes(&self) -> u64 {
        if let Err(error) = remove_unborn(&self.prefix) {
            tracing::warn!(%error, "what a dead process was just creating was not removed");
        }
        let state = self.bus().node().try_cleanup_dead_nodes();
        if state.failed_cleanups > 0 {
            tracing::warn!(failed = state.failed_cleanups, "could not clean up after a dead process");
        }
        state.cleanups
    }

    /// Removes everything of this prefix; the same as dropping it.
    pub fn close(self) {}
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.channels.clear();
        self.bus = None;
        // The lock is still held: nobody can have begun anew under this prefix.
        if let Err(error) = wipe(&self.prefix, &[self.prefix.lock_file()]).and_then(|()| remove_directory(&self.prefix))
        {
            tracing::warn!(%error, "the prefix was not removed whole");
        }
    }
}

struct Creator<'a> {
    node: &'a Node<ipc::Service>,
    channels: Vec<Box<dyn Any>>,
}

impl Creator<'_> {
    fn create_bell(&mut self, reader: Reader) -> Result<(), BusError> {
        let name = reader.bell();
        let event = self
            .node
            .service_builder(&service_name(&name)?)
            .event()
            .max_nodes(NODES)
            .max_notifiers(RINGERS)
            .max_listeners(8)
            .create()
            .map_err(|error| BusError::layer("create event", &name, error))?;
        self.channels.push(Box::new(event));
        Ok(())
    }
}

impl ChannelVisitor for Creator<'_> {
    type Error = BusError;

    fn visit<T: Message>(&mut self, channel: &Channel<T>) -> Result<(), BusError> {
        let spec = &channel.spec;
        let service = self
            .node
            .service_builder(&service_name(spec.name)?)
            .publish_subscribe::<T>()
            .enable_safe_overflow(spec.overflow == Overflow::DropOldest)
            .subscriber_max_buffer_size(spec.queue)
            .history_size(spec.history)
            .subscriber_max_borrowed_samples(1)
            .max_publishers(spec.publishers)
            .max_subscribers(spec.subscribers)
            .max_nodes(NODES)
            .create_with_attributes(&stated_layout(channel)?)
            .map_err(|error| BusError::layer("create channel", spec.name, error))?;
        self.channels.push(Box::new(service));
        Ok(())
    }
}

/// Locks the prefix for this process and writes its number into the lock file.
fn lock(prefix: &Prefix) -> Result<File, BusError> {
    let path = prefix.lock_file();
    loop {
        make_directory(prefix)?;
        let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = match opened {
            // The former owner removed the directory in between.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            other => other.map_err(BusError::io("open", &path))?,
        };
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                let mut pid = String::new();
                // What cannot be read, the message calls unknown.
                let _ = file.read_to_string(&mut pid);
                let pid = if pid.trim().is_empty() { "unknown".to_owned() } else { pid.trim().to_owned() };
                return Err(BusError::InUse { prefix: prefix.name().to_owned(), pid });
            }
            Err(error) => return Err(BusError::io("lock", &path)(error.into())),
        }
        // Locked, but is it still the file of that name? The former owner may have removed it.
        let ours = file.metadata().map_err(BusError::io("look at", &path))?;
        if !fs::metadata(&path).is_ok_and(|there| (there.dev(), there.ino()) == (ours.dev(), ours.ino())) {
            continue;
        }
        file.set_len(0)
            .and_then(|()| file.write_all(std::process::id().to_string().as_bytes()))
            .map_err(BusError::io("write", &path))?;
        return Ok(file);
    }
}

fn make_directory(prefix: &Prefix) -> Result<(), BusError> {
    let path = prefix.directory();
    match fs::DirBuilder::new().mode(0o700).create(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
            let found = fs::symlink_metadata(&path).map_err(BusError::io("look at", &path))?;
            let ours = found.is_dir() && found.uid() == rustix::process::geteuid().as_raw();
            if ours { Ok(()) } else { Err(BusError::NotOurs { path }) }
        }
        other => other.map_err(BusError::io("create", &path)),
    }
}

/// Removes every shared memory object of the prefix, and what lies in its directory but for what is kept: the lock, which must be
/// held, at least.
fn wipe(prefix: &Prefix, kept: &[PathBuf]) -> Result<(), BusError> {
    let objects = prefix.object_prefix();
    remove_where(Path::new(SHARED_MEMORY), |name| name.starts_with(&objects))?;
    let directory = prefix.directory();
    remove_where(&directory, |name| !kept.contains(&directory.join(name)))
}

/// Removes shared memory objects that a process was just creating when it was killed: they have a name, and no size yet.
///
/// The layer waits for their creator without end (in 0.10.0 an object without size is not held against its time-out), and with it
/// whoever opens or cleans up such a connection: first of all the owner, and then nobody is started again.
fn remove_unborn(prefix: &Prefix) -> Result<(), BusError> {
    let objects = prefix.object_prefix();
    let directory = Path::new(SHARED_MEMORY);
    let is_empty = |name: &str| fs::metadata(directory.join(name)).is_ok_and(|data| data.len() == 0);
    remove_where(directory, |name| name.starts_with(&objects) && is_empty(name) && names_a_dead_process(name))
}

/// Whether a port named in an object's name is that of a process that is gone. A port's number is that of the layer's
/// `UniqueSystemId`: seconds, nanoseconds, process and a counter of 32 bits each, the first the lowest.
fn names_a_dead_process(name: &str) -> bool {
    let ports = name.split(['_', '.']).filter_map(|part| part.parse::<u128>().ok());
    let mut processes = ports.map(|port| (port >> 64) as u32).filter(|&pid| pid != 0);
    processes.any(|pid| !Path::new("/proc").join(pid.to_string()).exists())
}

fn remove_where(directory: &Path, wanted: impl Fn(&str) -> bool) -> Result<(), BusError> {
    for entry in fs::read_dir(directory).map_err(BusError::io("list", directory))? {
        let entry = entry.map_err(BusError::io("list", directory))?;
        if !entry.file_name().to_str().is_some_and(&wanted) {
            continue;
        }
        let path = entry.path();
        let is_directory = entry.file_type().is_ok_and(|kind| kind.is_dir());
        let removed = if is_directory { remove_filling(&path) } else { fs::remove_file(&path) };
        match removed {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(BusError::io("remove", path)(error));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Removes a directory that others may still be putting files into.
fn remove_filling(directory: &Path) -> std::io::Result<()> {
    let deadline = Instant::now() + LAST_BREATH;
    loop {
        match fs::remove_dir_all(directory) {
            Err(error) if error.kind() == std::io::ErrorKind::DirectoryNotEmpty && Instant::now() < deadline => {
                std::thread::sleep(Duration::from_millis(1));
            }
            other => return other,
        }
    }
}

fn remove_directory(prefix: &Prefix) -> Result<(), BusError> {
    let (lock, directory) = (prefix.lock_file(), prefix.directory());
    fs::remove_file(&lock).map_err(BusError::io("remove", lock))?;
    match fs::remove_dir(&directory) {
        // Somebody is just taking the prefix and has made a new lock file there.
        Err(error) if error.kind() == std::io::ErrorKind::DirectoryNotEmpty => Ok(()),
        other => other.map_err(BusError::io("remove", directory)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_is_removed_while_somebody_still_puts_files_into_it() {
        let directory = std::env::temp_dir().join(format!("ilns-filling-{}", std::process::id()));
        for _ in 0..20 {
            fs::create_dir(&directory).expect("writable");
            let until = Instant::now() + Duration::from_millis(20);
            let fill = |stem: &str| {
                let names = (0_u32..).take_while(|_| Instant::now() < until);
                // Once it is gone, nobody can any more.
                let mut written = names.map(|n| fs::write(directory.join(format!("{stem}{n}")), []));
                written.all(|written| written.is_ok())
            };
            std::thread::scope(|scope| {
                scope.spawn(|| fill("a"));
                scope.spawn(|| fill("b"));
                std::thread::sleep(Duration::from_millis(5));
                remove_filling(&directory).expect("given time, it is empty once");
            });
            assert!(!directory.exists());
        }
    }
}
