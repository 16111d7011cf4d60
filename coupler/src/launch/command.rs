//! Command lines of the solver programs.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use case::{Role, Scene};
use coupling::error::RunError;
use terminal::shell::{quote, split_words};

/// One program of a stage, ready to be started.
#[derive(Clone, Debug)]
pub struct Program {
    /// Its role.
    pub role: Role,
    /// Name in messages.
    pub name: String,
    /// Command and arguments.
    pub words: Vec<OsString>,
    /// Environment variables in addition to those of the coupler.
    pub environment: Vec<(&'static str, OsString)>,
    /// File for all its output.
    pub log: PathBuf,
    /// Appends to the log, for a resumed stage.
    pub continues: bool,
}

impl Program {
    /// The command as a line that can be pasted into a shell.
    pub fn line(&self) -> String {
        let quoted = self.words.iter().map(|w| quote(&w.to_string_lossy()));
        quoted.collect::<Vec<_>>().join(" ")
    }
}

impl Program {
    /// Whether all its ranks run on this host.
    pub(super) fn on_this_host(&self) -> bool {
        self.environment.iter().any(|(name, _)| *name == SCRATCH)
    }

    /// Number of ranks of `mpirun -n N`.
    pub(super) fn ranks(&self) -> usize {
        let of = self.words.get(2).and_then(|n| n.to_str()).and_then(|n| n.parse().ok());
        of.filter(|_| self.words[0] == "mpirun").unwrap_or(1)
    }

    /// As [`Program::line`], with its environment variables.
    pub fn shell_line(&self) -> String {
        let set = self.environment.iter().map(|(k, v)| format!("{k}={}", quote(&v.to_string_lossy())));
        format!("env {} {}", set.collect::<Vec<_>>().join(" "), self.line())
    }
}

/// Input of the command lines of a stage.
pub struct LaunchPlan<'a> {
    /// The scene, with overridden rank counts and programs.
    pub scene: &'a Scene,
    /// Its file.
    pub scene_file: &'a Path,
    /// Stage, from 0.
    pub stage: usize,
    /// Session to join.
    pub session: &'a str,
    /// Folder of the run's results.
    pub out: &'a Path,
    /// Folder of the project's programs.
    pub programs: &'a Path,
    /// Folder for MPI's temporary files, removed after the run.
    pub scratch: &'a Path,
    /// Options for `mpirun`, of one program or of all.
    pub mpirun: &'a [(Option<Role>, String)],
    /// Checkpoint within the stage that the programs restart from.
    pub resume: Option<&'a Path>,
}

impl LaunchPlan<'_> {
    /// The programs of the stage in launch order.
    ///
    /// # Errors
    /// [`RunError::Input`]: a program does not exist, or a command cannot be
    /// parsed.
    pub fn programs(&self) -> Result<Vec<Program>, RunError> {
        if !can_be_found("mpirun") {
            return Err(RunError::Input(
                "`mpirun` is not on the PATH: install OpenMPI (`apt install openmpi-bin`)".into(),
            ));
        }
        let roles = self.scene.roles(&self.scene.stages[self.stage]);
        roles.iter().map(|&role| self.program(role)).collect()
    }

    /// The program of one role.
    ///
    /// # Errors
    /// As [`LaunchPlan::programs`].
    pub fn program(&self, role: Role) -> Result<Program, RunError> {
        let (name, command) = match self.scene.programs.get(&role) {
            Some(line) => replaced(role, line)?,
            None => self.own(role)?,
        };
        let (mut words, environment) = self.mpirun(role);
        words.extend(command);
        words.extend(self.arguments(role));
        let folder = case::stage_folder(self.out, self.scene, self.stage);
        let log = folder.join("logs").join(format!("{}.log", role.name()));
        Ok(Program { role, name, words, environment, log, continues: self.resume.is_some() })
    }

    /// The project's own program: its name and its command.
    fn own(&self, role: Role) -> Result<(String, Vec<OsString>), RunError> {
        let file = self.programs.join(role.program());
        if !file.is_file() {
            return Err(RunError::Input(format!(
                "{} does not exist: build it with `cargo build --release`, or name another program \
                 for this role with --{} \"COMMAND\"",
                file.display(),
                role.name()
            )));
        }
        Ok((role.program().to_owned(), vec![file.into_os_string()]))
    }

    /// The `mpirun` command before that of the program, and the environment of its ranks.
    fn mpirun(&self, role: Role) -> (Vec<OsString>, Vec<(&'static str, OsString)>) {
        let ranks = self.scene.ranks.of(role).to_string();
        let mut words: Vec<OsString> = vec!["mpirun".into(), "-n".into(), ranks.into()];
        let hosts: Vec<String> = self
            .mpirun
            .iter()
            .filter(|(of, _)| of.is_none_or(|of| of == role))
            .flat_map(|(_, options)| split_words(options).unwrap_or_default())
            .collect();
        let environment = environment((hosts.is_empty()).then_some(self.scratch));
        if !hosts.is_empty() {
            words.extend(hosts.into_iter().map(OsString::from));
            // By default mpirun passes only OMPI_ variables to other hosts.
            for (name, _) in environment.iter().filter(|(name, _)| !name.starts_with("OMPI_")) {
                words.extend(["-x".into(), (*name).into()]);
            }
        }
        (words, environment)
    }

    /// The arguments that the contract defines.
    fn arguments(&self, role: Role) -> Vec<OsString> {
        let mut words = Vec::new();
        let arguments: [(&str, OsString); 5] = [
            ("--scene", self.scene_file.into()),
            ("--stage", self.stage.to_string().into()),
            ("--session", self.session.into()),
            ("--out", self.out.into()),
            ("--ranks", self.scene.ranks.of(role).to_string().into()),
        ];
        for (key, value) in arguments {
            words.extend([OsString::from(key), value]);
        }
        if let Some(folder) = self.resume {
            words.extend([OsString::from("--resume"), folder.into()]);
        }
        words
    }
}

/// The name and the command of a program that replaces the project's, from its command `line`.
fn replaced(role: Role, line: &str) -> Result<(String, Vec<OsString>), RunError> {
    let words = split_words(line).filter(|w| !w.is_empty()).ok_or_else(|| {
        RunError::Input(format!(
            "the command for {}, `{line}`, is empty or has an unclosed quote",
            role.name()
        ))
    })?;
    if !can_be_found(&words[0]) {
        return Err(RunError::Input(format!(
            "the program `{}` for {} does not exist: check the path of --{} or of `programs` in \
             the scene (relative paths start at the current folder of ripstop)",
            words[0],
            role.name(),
            role.name()
        )));
    }
    Ok((format!("{} (`{line}`)", role.name()), words.into_iter().map(OsString::from).collect()))
}

/// Folder of OpenMPI's temporary files; set if all ranks run on this host.
const SCRATCH: &str = "OMPI_MCA_orte_tmpdir_base";

/// Settings of the C library's allocator.
const ALLOCATOR: &str = "GLIBC_TUNABLES";

/// Environment variables of a program under OpenMPI. Several programs share the cores, so
/// ranks are not bound, yield when idle, and use one thread each. `scratch`: folder of
/// MPI's temporary files, if all ranks run on this host.
pub(super) fn environment(scratch: Option<&Path>) -> Vec<(&'static str, OsString)> {
    let mut set: Vec<(&'static str, OsString)> = vec![
        ("OMPI_MCA_rmaps_base_oversubscribe", "1".into()),
        ("OMPI_MCA_hwloc_base_binding_policy", "none".into()),
        ("OMPI_MCA_mpi_yield_when_idle", "1".into()),
        // Many containers forbid cross-memory attach, which gives a warning for each rank.
        ("OMPI_MCA_btl_vader_single_copy_mechanism", "none".into()),
        // OpenMPI's notice often omits the number of a rank that fails before MPI_Init; state records contain it.
        ("OMPI_MCA_state_base_verbose", "1".into()),
        ("OMP_NUM_THREADS", "1".into()),
        ("RAYON_NUM_THREADS", "1".into()),
    ];
    // Arrays in large pages where the system gives them on request only: a solve that follows those of other programs finds fewer pages in the cache.
    if std::env::var_os(ALLOCATOR).is_none() {
        set.push((ALLOCATOR, "glibc.malloc.hugetlb=1".into()));
    }
    // By default mpirun waits one or two seconds after a rank has died before it says so. A run that ends gives its ranks time
    // itself (`Supervisor::end`).
    if std::env::var_os("OMPI_MCA_odls_base_sigkill_timeout").is_none() {
        set.push(("OMPI_MCA_odls_base_sigkill_timeout", "0".into()));
    }
    // In one folder, which is removed even if a rank was killed.
    if let Some(scratch) = scratch {
        set.push((SCRATCH, scratch.into()));
        set.push(("OMPI_MCA_btl_vader_backing_directory", scratch.into()));
        // The search for network adapters takes 0.2 s at each start.
        if std::env::var_os("OMPI_MCA_pml").is_none() {
            set.push(("OMPI_MCA_pml", "^cm".into()));
        }
    }
    // For programs in other languages, which call `ripstop mesh`.
    if let Ok(me) = std::env::current_exe() {
        set.push(("RIPSTOP", me.into()));
    }
    if rustix::process::geteuid().is_root() {
        set.push(("OMPI_ALLOW_RUN_AS_ROOT", "1".into()));
        set.push(("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1".into()));
    }
    set
}

/// Whether a shell would find this program: a file, or a name on the PATH.
fn can_be_found(program: &str) -> bool {
    if program.contains('/') {
        return Path::new(program).is_file();
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}
