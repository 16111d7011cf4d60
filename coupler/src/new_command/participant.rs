//! `ripstop new participant`: a package of a solver program that replaces one of Ripstop's.

use std::path::{Path, PathBuf};

use case::Role;
use coupling::error::RunError;
use results::program::program_folder;

/// Arguments of `ripstop new participant`.
#[derive(clap::Args, Clone, Debug)]
pub struct ParticipantArgs {
    /// Role of the program: structure, flow or mesh
    #[arg(long, value_name = "ROLE", value_parser = crate::arguments::role)]
    role: Role,
    /// Language of the program
    #[arg(long, value_enum, default_value_t = Language::Rust)]
    lang: Language,
    /// Folder of the package, whose last part is its name [default: my-ROLE]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Sources of Ripstop, which the package depends on [default: those that this program was built in]
    #[arg(long, value_name = "DIR")]
    sources: Option<PathBuf>,
}

/// Language of a program.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum Language {
    Rust,
    Python,
    #[value(name = "c++")]
    Cpp,
    Fortran,
}

/// The model that the package starts with, by role.
const MODELS: [(Role, &str); 3] = [
    (Role::Structure, "a net of masses and springs"),
    (Role::Flow, "a flow model of one equation"),
    (Role::Mesh, "inverse-distance interpolation"),
];

const RUST: [(Role, &str); 3] = [
    (Role::Structure, include_str!("../../../crates/participant/examples/structure.rs")),
    (Role::Flow, include_str!("../../../crates/participant/examples/flow.rs")),
    (Role::Mesh, include_str!("../../../crates/participant/examples/mesh.rs")),
];

const PYTHON: [(Role, &str); 3] = [
    (Role::Structure, include_str!("../../../python/examples/mass_spring.py")),
    (Role::Flow, include_str!("../../../python/examples/stagnation_flow.py")),
    (Role::Mesh, include_str!("../../../python/examples/inverse_distance.py")),
];

const CPP: &[(Role, &str)] = &[
    (Role::Structure, include_str!("../../../crates/participant-c/examples/structure.cpp")),
    (Role::Mesh, include_str!("../../../crates/participant-c/examples/mesh.cpp")),
    (Role::Flow, include_str!("../../../crates/participant-c/examples/flow.cpp")),
];

const FORTRAN: &[(Role, &str)] =
    &[(Role::Mesh, include_str!("../../../crates/participant-c/examples/mesh.f90"))];

/// Rust sources that a package needs, relative to the sources of Ripstop.
const CRATE: &str = "crates/participant";
/// The C interface, which packages in C++ and Fortran need.
const C_CRATE: &str = "crates/participant-c";

/// Writes the package; returns what to print.
///
/// # Errors
/// [`RunError::Input`]: the folder exists, or its name is not that of a package; there are no sources. Files that cannot be written.
pub(super) fn new_participant(args: &ParticipantArgs) -> Result<String, RunError> {
    let folder = args.out.clone().unwrap_or_else(|| format!("my-{}", args.role.name()).into());
    let name = package_name(&folder)?;
    let sources = sources(args.sources.as_deref())?;
    let package = Package { role: args.role, name: &name, folder: &folder, sources: &sources };
    let files = match args.lang {
        Language::Rust => package.rust()?,
        Language::Python => package.python(),
        Language::Cpp => package.compiled(&CXX)?,
        Language::Fortran => package.compiled(&GFORTRAN)?,
    };
    if folder.exists() {
        return Err(RunError::Input(format!("{} exists: name another folder with --out", folder.display())));
    }
    for (file, text) in files {
        let path = folder.join(file);
        let parent = path.parent().unwrap_or(&folder);
        std::fs::create_dir_all(parent).map_err(RunError::file("create", parent))?;
        std::fs::write(&path, text).map_err(RunError::file("write", &path))?;
    }
    let shown = folder.display();
    Ok(format!(
        "{shown}: {} in place of {}\nnext: {shown}/README.md",
        of(&MODELS, args.role),
        args.role.program()
    ))
}

/// A language whose programs link the C interface.
struct Compiled {
    name: &'static str,
    models: &'static [(Role, &'static str)],
    file: &'static str,
    /// Lines of the Makefile that choose the compiler.
    compiler: &'static str,
    /// How the Makefile compiles: the files before `-o`.
    compile: &'static str,
}

const CXX: Compiled = Compiled {
    name: "C++",
    models: CPP,
    file: "main.cpp",
    compiler: "CXXFLAGS = -std=c++11 -O2 -Wall -Wextra",
    compile: "$(CXX) $(CXXFLAGS) -I$(INTERFACE)/include main.cpp",
};

// `FC` of make is f77, which few machines have.
const GFORTRAN: Compiled = Compiled {
    name: "Fortran",
    models: FORTRAN,
    file: "main.f90",
    compiler: "FC = gfortran\nFFLAGS = -std=f2003 -O2 -Wall -Wno-unused-dummy-argument",
    compile: "$(FC) $(FFLAGS) $(INTERFACE)/fortran/ripstop.f90 main.f90",
};

fn of<T: Copy>(table: &[(Role, T); 3], role: Role) -> T {
    table[role as usize].1
}

/// The name of the package in `folder`.
fn package_name(folder: &Path) -> Result<String, RunError> {
    let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
    if name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(fits) {
        return Ok(name);
    }
    Err(RunError::Input(format!(
        "`{}` does not end with the name of a package: write a folder such as my-flow, of small letters, digits, - and _",
        folder.display()
    )))
}

/// The sources of Ripstop: `given`, or a folder above this program.
fn sources(given: Option<&Path>) -> Result<PathBuf, RunError> {
    let program = program_folder()?;
    let found = match given {
        Some(folder) => Some(folder).filter(|f| f.join(CRATE).is_dir()),
        None => program.ancestors().find(|f| f.join(CRATE).is_dir()),
    };
    let found = found.and_then(|folder| folder.canonicalize().ok());
    found.ok_or_else(|| {
        let place = given.unwrap_or(&program).display();
        RunError::Input(format!(
            "the sources of Ripstop are not at {place} (no folder {CRATE}): name their folder with --sources"
        ))
    })
}

/// A package to write.
struct Package<'a> {
    role: Role,
    name: &'a str,
    folder: &'a Path,
    sources: &'a Path,
}

impl Package<'_> {
    fn rust(&self) -> Result<Vec<(String, String)>, RunError> {
        let lock = self.sources.join("Cargo.lock");
        // The versions that Ripstop was tested with; cargo drops what this package does not need.
        let lock = std::fs::read_to_string(&lock).map_err(RunError::file("read", &lock))?;
        let manifest = format!(
            "[package]\nname = \"{}\"\nversion = \"0.1.0\"\nedition = \"2024\"\nrust-version = \"{}\"\n\n[dependencies]\n\
             ripstop-participant = {{ path = {:?} }}\n\n# A package of its own, also in a folder of another workspace.\n[workspace]\n",
            self.name,
            env!("CARGO_PKG_RUST_VERSION"),
            self.sources.join(CRATE)
        );
        let command = format!("{}/target/release/{}", self.folder.display(), self.name);
        let build = format!("cargo build --release --manifest-path {}/Cargo.toml", self.folder.display());
        Ok(vec![
            ("Cargo.toml".into(), manifest),
            ("Cargo.lock".into(), lock),
            (".gitignore".into(), "/target\n".into()),
            ("src/main.rs".into(), of(&RUST, self.role).into()),
            ("README.md".into(), self.readme("src/main.rs", &format!("{build}\n"), &command)),
        ])
    }

    fn python(&self) -> Vec<(String, String)> {
        let file = format!("{}.py", self.name.replace('-', "_"));
        let command = format!("python3 {}/{file}", self.folder.display());
        let install = format!("pip install {}/python\n", self.sources.display());
        vec![
            (file.clone(), python_program(self.role)),
            ("README.md".into(), self.readme(&file, &install, &command)),
        ]
    }

    /// A package with a Makefile.
    ///
    /// # Errors
    /// The language has no model of this role; the sources lack the C interface.
    fn compiled(&self, language: &Compiled) -> Result<Vec<(String, String)>, RunError> {
        let found = language.models.iter().find(|(role, _)| *role == self.role);
        let Some((_, text)) = found else {
            let have: Vec<&str> = language.models.iter().map(|(role, _)| role.name()).collect();
            return Err(RunError::Input(format!(
                "there is no model of the role {} in {}: use --role {}, or --lang rust or python, and see \
                 docs/reference/participants.md for the calls of every role",
                self.role.name(),
                language.name,
                have.join(" or --role ")
            )));
        };
        if !self.sources.join(C_CRATE).is_dir() {
            return Err(RunError::Input(format!(
                "the sources of Ripstop at {} have no folder {C_CRATE}: name newer ones with --sources",
                self.sources.display()
            )));
        }
        let folder = self.folder.display();
        let build = format!("make -C {folder}\n");
        let readme = self.readme(language.file, &build, &format!("{folder}/{}", self.name));
        Ok(vec![
            (language.file.into(), (*text).into()),
            ("Makefile".into(), self.makefile(language)),
            (".gitignore".into(), format!("/{}\n*.mod\n", self.name)),
            ("README.md".into(), readme),
        ])
    }

    fn makefile(&self, language: &Compiled) -> String {
        format!(
            "# Sources of Ripstop, with the interface and its library. After a change of them: make -B\n\
             SOURCES = {}\n\
             INTERFACE = $(SOURCES)/{C_CRATE}\n\
             LIBRARY = $(or $(CARGO_TARGET_DIR),$(SOURCES)/target)/release/libripstop_participant_c.a\n\
             {}\n\n\
             {}: {} $(LIBRARY)\n\
             \t{} -o $@ -Wl,--gc-sections $(LIBRARY) -lpthread -ldl -lm\n\n\
             $(LIBRARY):\n\
             \tcargo build --release --locked --manifest-path $(SOURCES)/Cargo.toml -p ripstop-participant-c\n",
            self.sources.display(),
            language.compiler,
            self.name,
            language.file,
            language.compile
        )
    }

    fn readme(&self, file: &str, prepare: &str, command: &str) -> String {
        let role = self.role.name();
        format!(
            "# {}\n\n{} in place of the {} of Ripstop: [{file}]({file}). Change it into a model of yours.\n\nFrom the folder in which `ripstop new` was started:\n\n```sh\n{prepare}\
             export PATH={}/target/release:$PATH\n\
             SCENE={}/cases/square-drop/scene.toml\n\
             ripstop run $SCENE --{role} \"{command}\" --out runs/mine --record mine\n\
             ripstop conform {role} mine --command \"{command}\"   # protocol and physics, test by test\n```\n\n\
             The rules: docs/how-to/replace-a-solver.md and docs/reference/contract.md in the sources of Ripstop.\n",
            self.name,
            capitalised(of(&MODELS, self.role)),
            self.role.program(),
            self.sources.display(),
            self.sources.display(),
        )
    }
}

/// The example without the lines that find the package `ripstop` in the sources.
fn python_program(role: Role) -> String {
    let text = of(&PYTHON, role);
    let text = text.replace("import sys\nfrom pathlib import Path\n\nimport numpy", "import numpy");
    let found = "\nsys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # found without installation\nimport ripstop  # noqa: E402";
    text.replace(found, "import ripstop")
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(folder: &Path, role: Role, lang: Language) -> ParticipantArgs {
        ParticipantArgs { role, lang, out: Some(folder.into()), sources: None }
    }

    #[test]
    fn tables_are_in_the_order_of_roles() {
        for (index, role) in Role::ALL.into_iter().enumerate() {
            assert_eq!(role as usize, index);
            assert_eq!((MODELS[index].0, RUST[index].0, PYTHON[index].0), (role, role, role));
        }
    }

    #[test]
    fn packages_are_written_once() {
        let folder = tempfile::tempdir().unwrap();
        for role in Role::ALL {
            let out = folder.path().join(format!("my-{}", role.name()));
            let said = new_participant(&args(&out, role, Language::Rust)).unwrap();
            assert!(said.contains(role.program()), "{said}");
            let manifest = std::fs::read_to_string(out.join("Cargo.toml")).unwrap();
            assert!(
                manifest.contains("crates/participant\"") && manifest.contains("[workspace]"),
                "{manifest}"
            );
            let readme = std::fs::read_to_string(out.join("README.md")).unwrap();
            assert!(readme.contains(&format!("ripstop conform {}", role.name())), "{readme}");
            let again = new_participant(&args(&out, role, Language::Rust)).unwrap_err().to_string();
            assert!(again.contains("--out"), "{again}");
        }
    }

    #[test]
    fn python_programs_do_not_look_for_the_sources() {
        let folder = tempfile::tempdir().unwrap();
        for role in Role::ALL {
            let out = folder.path().join(format!("py-{}", role.name()));
            new_participant(&args(&out, role, Language::Python)).unwrap();
            let text = std::fs::read_to_string(out.join(format!("py_{}.py", role.name()))).unwrap();
            assert!(
                text.contains("\nimport numpy as np\nimport ripstop\n") && !text.contains("sys.path"),
                "{text}"
            );
        }
        // The tutorial builds the same flow, line by line.
        let tutorial = include_str!("../../../docs/tutorials/flow-solver-in-python.md");
        let program = python_program(Role::Flow);
        assert!(tutorial.contains(&program[program.find("import numpy").unwrap()..]));
    }

    #[test]
    fn compiled_packages_name_the_interface() {
        let folder = tempfile::tempdir().unwrap();
        for (lang, language) in [(Language::Cpp, &CXX), (Language::Fortran, &GFORTRAN)] {
            for role in Role::ALL {
                let out =
                    folder.path().join(format!("{}-{}", role.name(), language.file.replace("main.", "")));
                let made = new_participant(&args(&out, role, lang));
                if !language.models.iter().any(|(of, _)| *of == role) {
                    let error = made.unwrap_err().to_string();
                    assert!(error.contains(language.name) && error.contains("--role"), "{error}");
                    assert!(!out.exists());
                    continue;
                }
                made.unwrap();
                let makefile = std::fs::read_to_string(out.join("Makefile")).unwrap();
                assert!(makefile.contains("-p ripstop-participant-c\n"), "{makefile}");
                assert!(out.join(language.file).is_file());
                let readme = std::fs::read_to_string(out.join("README.md")).unwrap();
                assert!(readme.contains("\nmake -C "), "{readme}");
            }
        }
    }

    #[test]
    fn names_that_no_package_has_are_refused() {
        for name in ["/tmp/My Flow", "/tmp/1flow", "/"] {
            let error = package_name(Path::new(name)).unwrap_err().to_string();
            assert!(error.contains("my-flow"), "{error}");
        }
        let none = sources(Some(Path::new("/nowhere"))).unwrap_err().to_string();
        assert!(none.contains("/nowhere") && none.contains("--sources"), "{none}");
    }
}
