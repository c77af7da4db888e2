//! What the process file asks of the system for one process: a core, a priority, memory that is there.
//!
//! A refusal is a warning with the command that would grant it, never a failure: a pose that is late now and then is
//! better than none.

use std::hint::black_box;
use std::path::Path;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_setaffinity};
use shared_types::Process;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use tracing::{info, warn};

use crate::process_file::{ProcessFile, ProcessFileError, ProcessSettings, WakeUp};

/// Stack that is faulted in before the loop, bytes; the deepest loop, the solver's, uses a fraction of it.
const STACK: usize = 512 * 1024;

/// What one process is to ask of the system.
#[derive(Clone, Copy, Debug)]
pub struct RealTime {
    process: Process,
    settings: ProcessSettings,
}

impl RealTime {
    /// What `file` says of `process`; without a file, nothing is asked.
    ///
    /// # Errors
    /// [`ProcessFileError`].
    pub fn of(process: Process, file: Option<&Path>) -> Result<RealTime, ProcessFileError> {
        let file = file.map(ProcessFile::read).transpose()?.unwrap_or_default();
        Ok(RealTime { process, settings: file.of(process) })
    }

    /// Whether it looks for messages without end instead of sleeping until rung.
    pub fn polls(&self) -> bool {
        self.settings.wake_up == WakeUp::Poll
    }

    /// The same, bound to no core.
    #[must_use]
    pub fn anywhere(self) -> RealTime {
        RealTime { settings: ProcessSettings { core: None, ..self.settings }, ..self }
    }

    /// Asks the system, for the calling thread and the memory of its process. Call once every port is open, just before the
    /// loop: opening takes memory and time that are none of the loop's. Threads started later inherit core and priority.
    pub fn enter(&self) {
        let ProcessSettings { core, priority, lock_memory, .. } = self.settings;
        if let Some(core) = core {
            self.bind_to(core);
        }
        if lock_memory {
            self.lock_memory();
            fault_in_stack();
        }
        if let Some(priority) = priority {
            self.raise_to(priority);
        }
        if self.settings != ProcessSettings::default() {
            info!(process = self.process.name(), ?core, ?priority, lock_memory, polls = self.polls(), "real time");
        }
    }

    fn bind_to(&self, core: usize) {
        let mut cores = CpuSet::new();
        cores.set(core);
        if let Err(error) = sched_setaffinity(None, &cores) {
            warn!(
                process = self.process.name(), core, %error,
                "it is not bound to its core (grant: AllowedCPUs= of the unit must name the core, and \
                 `cat /sys/devices/system/cpu/online` must show it)"
            );
        }
    }

    fn raise_to(&self, priority: u8) {
        let value = ThreadPriorityValue::try_from(priority).expect("the process file allows 1 to 99");
        let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let raised = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo);
        if let Err(error) = raised {
            warn!(
                process = self.process.name(),
                priority,
                ?error,
                "it runs at ordinary priority (grant: `sudo setcap cap_sys_nice,cap_ipc_lock+ep $(command -v ilns)`, or \
                 LimitRTPRIO=99 in the unit)"
            );
        }
    }

    fn lock_memory(&self) {
        // With a limit, a lock on what is mapped later would turn that mapping into a failure.
        let unlimited = getrlimit(Resource::Memlock).current.is_none()
            || capabilities(None).is_ok_and(|own| own.effective.contains(CapabilitySet::IPC_LOCK));
        let flags = if unlimited { MlockAllFlags::CURRENT | MlockAllFlags::FUTURE } else { MlockAllFlags::CURRENT };
        let grant = "(grant: `ulimit -l unlimited` before the start, or LimitMEMLOCK=infinity in the unit)";
        match mlockall(flags) {
            Err(error) => warn!(process = self.process.name(), %error, "its memory is not locked {grant}"),
            Ok(()) if !unlimited => {
                warn!(process = self.process.name(), "memory that it maps later will not be locked {grant}");
            }
            Ok(()) => {}
        }
    }
}

/// Touches the stack below this frame, so that no later call meets a page for the first time.
#[inline(never)]
fn fault_in_stack() {
    let pages = [1_u8; STACK];
    black_box(&pages);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_the_system_refuses_the_process_goes_on() {
        // A core that no machine of ours has, and the highest priority: granted or refused, this returns.
        let settings =
            ProcessSettings { core: Some(1023), priority: Some(1), lock_memory: true, ..ProcessSettings::default() };
        let in_a_thread = std::thread::spawn(move || RealTime { process: Process::Solver, settings }.enter());
        assert!(in_a_thread.join().is_ok());
    }

    #[test]
    fn without_a_file_nothing_is_asked() {
        let real_time = RealTime::of(Process::Propagator, None).expect("no file, no mistake");
        assert_eq!(real_time.settings, ProcessSettings::default());
        assert!(!real_time.polls());
    }
}
