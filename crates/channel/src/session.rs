//! Files of a session on this machine, detection of its live processes, and cleanup.
//!
//! A session is a folder `/dev/shm/ripstop-<user>/<key>` and shared-memory files `/dev/shm/rs<key>_*`, where the key
//! is a hash of the session's name. Each process holds a lock on a file of its own in the folder while it lives: the
//! kernel releases it however the process ends, so liveness needs no process numbers, which are reused and differ
//! between containers.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use archive::hash::fnv1a;
use serde::{Deserialize, Serialize};

use crate::{Fault, SessionError};

pub(crate) const MEMORY: &str = "/dev/shm";
pub(crate) const LOCK: &str = "lock.";
/// Digits of a session's key.
pub(crate) const KEY_DIGITS: usize = 12;

/// Paths of one session.
#[derive(Clone, Debug)]
pub(crate) struct SessionPaths {
    pub session: String,
    key: String,
}

/// Contents of `session.json`, which the coupler writes for its participants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SessionInfo {
    pub contract: u32,
    pub session: String,
    /// Identity of this session, in each header (hexadecimal).
    pub id: String,
    pub pid: u32,
    /// Roles and their ranks.
    pub roles: Vec<(String, usize)>,
}

impl SessionPaths {
    pub fn of(session: &str) -> Result<Self, SessionError> {
        let fine = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
        if session.is_empty() || session.len() > 64 || !session.bytes().all(fine) {
            return Err(SessionError::BadName(session.into()));
        }
        // 12 hexadecimal digits keep socket paths short; a collision of two names is detected in `session.json`.
        let key = format!("{:016x}", fnv1a(session.bytes()))[..KEY_DIGITS].to_string();
        Ok(Self { session: session.into(), key })
    }

    pub fn folder(&self) -> PathBuf {
        base().join(&self.key)
    }

    /// Prefix of the names of the session's shared-memory files.
    pub fn prefix(&self) -> String {
        format!("rs{}_", self.key)
    }

    pub fn lock_file(&self, holder: &str) -> PathBuf {
        self.folder().join(format!("{LOCK}{holder}"))
    }

    fn info_file(&self) -> PathBuf {
        self.folder().join("session.json")
    }

    /// The contents of `session.json`, if the session is open.
    pub fn session_info(&self) -> Option<SessionInfo> {
        let session_info: SessionInfo = serde_json::from_slice(&fs::read(self.info_file()).ok()?).ok()?;
        (session_info.session == self.session).then_some(session_info)
    }

    /// Publishes `session.json` atomically.
    pub fn publish(&self, session_info: &SessionInfo) -> Result<(), SessionError> {
        let draft = self.folder().join("session.draft");
        let text = serde_json::to_vec_pretty(session_info).map_err(|e| at(&draft)(e.into()))?;
        let mut file = private().create(true).truncate(true).open(&draft).map_err(at(&draft))?;
        file.write_all(&text).map_err(at(&draft))?;
        fs::rename(&draft, self.info_file()).map_err(at(&draft))
    }

    /// Creates the session's folder and takes the coupler's lock. `Ok(Err(who))`: a process of a session of this name
    /// is still alive.
    pub fn open(&self) -> Result<Result<Lock, String>, SessionError> {
        let _guard = lock_base()?;
        let folder = self.folder();
        if let Some(who) = holder(&folder) {
            return Ok(Err(who));
        }
        self.remove_files()?;
        fs::DirBuilder::new().mode(0o700).create(&folder).map_err(at(&folder))?;
        let lock = Lock::take(&self.lock_file("coupler"))?;
        lock.ok_or_else(|| SessionError::StillAlive { session: self.session.clone(), who: "coupler".into() })
            .map(Ok)
    }

    /// Revokes the permissions of other users that the transport grants (its counter of processes is open to all by
    /// default).
    pub fn close_to_others(&self) -> Result<(), SessionError> {
        for path in memory_files(&self.prefix())? {
            let mode = fs::metadata(&path).map_err(at(&path))?.mode();
            if mode & 0o077 != 0 {
                fs::set_permissions(&path, fs::Permissions::from_mode(mode & 0o700)).map_err(at(&path))?;
            }
        }
        Ok(())
    }

    fn remove_files(&self) -> Result<(), SessionError> {
        remove_memory(&self.prefix())?;
        absent_is_fine(fs::remove_dir_all(self.folder())).map_err(at(&self.folder()))
    }

    /// Removes the remaining files of the session. An error if one of its processes is alive.
    pub fn clean(&self) -> Result<(), SessionError> {
        if !base().exists() {
            return remove_memory(&self.prefix());
        }
        let guard = lock_base()?;
        if let Some(who) = holder(&self.folder()) {
            return Err(SessionError::StillAlive { session: self.session.clone(), who });
        }
        self.remove_files()?;
        // Fails while there are other sessions, as intended.
        let _ = fs::remove_dir(base());
        drop(guard);
        Ok(())
    }
}

/// Removes the remaining files of `session` in shared memory, after all its processes have ended; the error names a process that
/// has not ended. No effect for an unknown session.
pub fn cleanup(session: &str) -> Result<(), SessionError> {
    SessionPaths::of(session)?.clean()
}

/// The folder and files of a session in shared memory. Empty after its end.
pub fn session_files(session: &str) -> Result<Vec<PathBuf>, SessionError> {
    let place = SessionPaths::of(session)?;
    let folder = place.folder();
    Ok(folder.exists().then_some(folder).into_iter().chain(memory_files(&place.prefix())?).collect())
}

/// Removes the remains of earlier runs of this user that were killed. Sessions with a live process are not touched.
/// Returns the number of removed sessions.
pub fn cleanup_stale() -> Result<usize, SessionError> {
    if !base().exists() {
        return Ok(0);
    }
    let _guard = lock_base()?;
    let mut removed = 0;
    let mut live = Vec::new();
    for entry in fs::read_dir(base()).map_err(at(&base()))?.flatten() {
        let key = entry.file_name().to_string_lossy().into_owned();
        let place = SessionPaths { session: String::new(), key };
        if holder(&place.folder()).is_some() {
            live.push(place.prefix());
        } else {
            place.remove_files()?;
            removed += 1;
        }
    }
    // Shared memory whose folder is missing: its name identifies it as ours.
    let uid = user();
    for entry in fs::read_dir(MEMORY).map_err(at(Path::new(MEMORY)))?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let ours = name.len() > 15
            && name.starts_with("rs")
            && name.as_bytes()[14] == b'_'
            && name[2..14].bytes().all(|b| b.is_ascii_hexdigit())
            && entry.metadata().is_ok_and(|m| m.is_file() && m.uid() == uid);
        if ours && !live.iter().any(|p| name.starts_with(p)) {
            absent_is_fine(fs::remove_file(entry.path())).map_err(at(&entry.path()))?;
        }
    }
    let _ = fs::remove_dir(base());
    Ok(removed)
}

/// Checks that shared memory has `bytes` free for `what`.
pub(crate) fn memory_for(what: &str, bytes: u64) -> Result<(), SessionError> {
    let path = Path::new(MEMORY);
    let name = std::ffi::CString::new(MEMORY).expect("no zero in it");
    let mut found = std::mem::MaybeUninit::<libc::statvfs>::zeroed();
    // SAFETY: a terminated string and room for the answer.
    if unsafe { libc::statvfs(name.as_ptr(), found.as_mut_ptr()) } != 0 {
        return Err(at(path)(io::Error::last_os_error()));
    }
    // SAFETY: plain numbers, zeroed before and filled by the successful call.
    let found = unsafe { found.assume_init() };
    let free = found.f_bavail * found.f_frsize;
    if bytes <= free {
        return Ok(());
    }
    Err(SessionError::Memory {
        path: path.into(),
        what: what.into(),
        needed: bytes.div_ceil(MB),
        free: free / MB,
    })
}

const MB: u64 = 1_000_000;

fn memory_files(prefix: &str) -> Result<Vec<PathBuf>, SessionError> {
    let entries = fs::read_dir(MEMORY).map_err(at(Path::new(MEMORY)))?.flatten();
    Ok(entries.filter(|e| e.file_name().to_string_lossy().starts_with(prefix)).map(|e| e.path()).collect())
}

fn remove_memory(prefix: &str) -> Result<(), SessionError> {
    memory_files(prefix)?.iter().try_for_each(|path| absent_is_fine(fs::remove_file(path)).map_err(at(path)))
}

fn absent_is_fine(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

/// Name of a live process in `folder`; the coupler first.
fn holder(folder: &Path) -> Option<String> {
    let files = fs::read_dir(folder).ok()?.flatten();
    let held = files.filter_map(|entry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        let who = name.strip_prefix(LOCK)?;
        LockMonitor::on(&entry.path()).is_some_and(|w| w.is_held()).then(|| who.to_string())
    });
    held.min_by_key(|who| who != "coupler")
}

/// A lock held while this process lives.
#[derive(Debug)]
pub(crate) struct Lock(File);

impl Drop for Lock {
    fn drop(&mut self) {
        // Closing is not enough: a child process that is being started temporarily has a copy of the descriptor.
        let mut free = whole_file();
        free.l_type = libc::F_UNLCK as libc::c_short;
        // SAFETY: an open descriptor and a valid `flock` for the length of the call.
        unsafe { libc::fcntl(self.0.as_raw_fd(), libc::F_OFD_SETLK, &raw mut free) };
    }
}

impl Lock {
    /// `None`: another process holds it.
    pub fn take(path: &Path) -> Result<Option<Self>, SessionError> {
        let file = private().read(true).create(true).open(path).map_err(at(path))?;
        let mut want = whole_file();
        // SAFETY: an open descriptor and a valid `flock` for the length of the call.
        let failed = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_OFD_SETLK, &raw mut want) } != 0;
        if !failed {
            return Ok(Some(Self(file)));
        }
        match io::Error::last_os_error() {
            e if matches!(e.raw_os_error(), Some(libc::EAGAIN | libc::EACCES)) => Ok(None),
            e => Err(at(path)(e)),
        }
    }
}

/// Monitors another process's [`Lock`].
#[derive(Debug)]
pub(crate) struct LockMonitor(File);

impl LockMonitor {
    /// `None`: no such file.
    pub fn on(path: &Path) -> Option<Self> {
        File::open(path).ok().map(Self)
    }

    /// Whether the process that took the lock is alive.
    pub fn is_held(&self) -> bool {
        let mut answer = whole_file();
        // SAFETY: an open descriptor and a valid `flock` for the length of the call.
        let ok = unsafe { libc::fcntl(self.0.as_raw_fd(), libc::F_OFD_GETLK, &raw mut answer) } == 0;
        ok && answer.l_type != libc::F_UNLCK as libc::c_short
    }
}

fn whole_file() -> libc::flock {
    libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    }
}

/// Opens or creates the folder of all sessions of this user and locks it against other processes that create or clean
/// sessions.
fn lock_base() -> Result<File, SessionError> {
    let path = base();
    loop {
        match fs::DirBuilder::new().mode(0o700).create(&path) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(at(&path)(e)),
            _ => {}
        }
        let Ok(found) = fs::symlink_metadata(&path) else { continue };
        let problem = if !found.is_dir() {
            "is not a folder"
        } else if found.uid() != user() {
            "belongs to another user"
        } else if found.mode() & 0o077 != 0 {
            "is open to other users"
        } else {
            ""
        };
        if !problem.is_empty() {
            return Err(SessionError::Untrusted { path, problem: problem.into() });
        }
        let Ok(folder) = File::open(&path) else { continue };
        // SAFETY: an open descriptor; the call has no other argument that must be valid.
        if unsafe { libc::flock(folder.as_raw_fd(), libc::LOCK_EX) } != 0 {
            match io::Error::last_os_error() {
                e if e.kind() == io::ErrorKind::Interrupted => continue,
                e => return Err(at(&path)(e)),
            }
        }
        // The folder may have been removed between opening and locking it.
        let same = |a: fs::Metadata, b: fs::Metadata| a.ino() == b.ino() && a.dev() == b.dev();
        if let (Ok(a), Ok(b)) = (folder.metadata(), fs::symlink_metadata(&path))
            && same(a, b)
        {
            return Ok(folder);
        }
    }
}

fn base() -> PathBuf {
    Path::new(MEMORY).join(format!("ripstop-{}", user()))
}

fn user() -> u32 {
    // SAFETY: no arguments, cannot fail.
    unsafe { libc::geteuid() }
}

fn private() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.write(true).mode(0o600);
    options
}

fn at(path: &Path) -> impl FnOnce(io::Error) -> SessionError {
    let path = path.to_path_buf();
    move |source| SessionError::File { path, source }
}

/// Text of a caught panic.
pub(crate) fn panic_fault(panic: Box<dyn std::any::Any + Send>) -> Fault {
    let text = panic
        .downcast_ref::<&str>()
        .map(|s| (*s).to_string())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".into());
    Fault::new(format!("panic: {text} (a bug in the program; RUST_BACKTRACE=1 shows the location)"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn session_names_are_validated() {
        for bad in ["", "a b", "../x", "a/b", &"x".repeat(65)] {
            assert!(matches!(SessionPaths::of(bad), Err(SessionError::BadName(_))), "{bad}");
        }
        let place = SessionPaths::of("run-1_a.b").expect("fine");
        assert_eq!(place.prefix().len(), 15);
        assert_ne!(place.prefix(), SessionPaths::of("run-1_a.c").expect("fine").prefix());
    }

    /// A socket's path may have 107 bytes. The transport's sockets lie in the
    /// session's folder and are named by prefix, a number of 128 bits, `.event`.
    #[test]
    fn socket_paths_stay_short() {
        let place = SessionPaths::of("x").expect("fine");
        let name = format!("{}{}.event", place.prefix(), u128::MAX);
        let longest = format!("/dev/shm/ripstop-{}/{}/{name}", u32::MAX, place.key);
        assert!(longest.len() <= 107, "{longest}");
    }

    #[test]
    fn locks_show_live_processes() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("lock.flow.0");
        assert!(LockMonitor::on(&path).is_none());
        let lock = Lock::take(&path).expect("a file").expect("free");
        let watch = LockMonitor::on(&path).expect("a file");
        assert!(watch.is_held());
        assert_eq!(holder(folder.path()).as_deref(), Some("flow.0"));
        assert!(Lock::take(&path).expect("a file").is_none(), "taken");
        drop(lock);
        assert!(!watch.is_held());
        assert_eq!(holder(folder.path()), None);
        assert!(Lock::take(&path).expect("a file").is_some(), "free again");
    }

    #[test]
    fn insufficient_memory_is_reported_before_use() {
        memory_for("a test", 4096).expect("a page is there");
        let error = memory_for("grid/0", u64::MAX).expect_err("too much").to_string();
        assert!(error.contains("grid/0") && error.contains("MB") && error.contains("/dev/shm"), "{error}");
    }
}
