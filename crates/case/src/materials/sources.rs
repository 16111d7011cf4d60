//! Where the values of the library come from, and how a value follows from its source.

/// How a value follows from its source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// Smallest value that the specification allows.
    SpecifiedMinimum,
    /// Largest value that the specification allows.
    SpecifiedMaximum,
    /// Middle of the range that the specification allows.
    MiddleOfRange,
    /// Measured on samples or stated by a maker.
    Typical,
    /// Secant modulus: strength over elongation at break.
    Secant,
    /// Follows from other values of the entry without an assumption.
    Derived,
    /// Estimated, as the note of the entry explains.
    Estimate,
    /// Assumed for all entries.
    Assumed,
    /// Value of the paper.
    Paper,
}

impl Basis {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            Basis::SpecifiedMinimum => "specified minimum",
            Basis::SpecifiedMaximum => "specified maximum",
            Basis::MiddleOfRange => "middle of the specified range",
            Basis::Typical => "typical",
            Basis::Secant => "secant from strength and elongation",
            Basis::Derived => "follows from the values above",
            Basis::Estimate => "estimate",
            Basis::Assumed => "assumption",
            Basis::Paper => "value of the paper",
        }
    }
}

/// Source of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// Types and weights of MIL-C-7020H.
    MilC7020h,
    /// Table of parachute cloths by R. Nakka.
    Nakka,
    /// Notes on parachute materials of the MIT Rocket Team.
    Mit,
    /// Fit to the permeability of 48 samples.
    Forchheimer,
    /// Types of PIA-C-44378D.
    PiaC44378d,
    /// Certificate of a lot by PIA-C-44378E.
    Certificate,
    /// Types of PIA-C-8021C.
    PiaC8021c,
    /// Materials of Spherachutes in OpenRocket.
    Spherachutes,
    /// Cord of MIL-C-5040H, type III.
    Paracord,
    /// Weights of MIL-C-5040H in a library of rocket materials.
    RocketMaterials,
    /// Lines of Fruity Chutes in OpenRocket.
    FruityChutes,
    /// Types of PIA-C-1200.
    PiaC1200,
    /// Types of PIA-C-2754D.
    PiaC2754d,
    /// Types of MIL-T-8363B.
    MilT8363b,
    /// Types of PIA-W-1100A.
    PiaW1100a,
    /// Table of industrial fibres by Teijin.
    Teijin,
    /// Yarn properties by Tension Technology.
    TensionTechnology,
    /// Table of rope fibres.
    RopeFibres,
    /// The paper.
    Paper,
    /// Not opened.
    Memory,
}

impl Source {
    /// All of them, in the order of the page.
    pub const ALL: [Source; 20] = [
        Source::MilC7020h,
        Source::Nakka,
        Source::Mit,
        Source::Forchheimer,
        Source::PiaC44378d,
        Source::Certificate,
        Source::PiaC8021c,
        Source::Spherachutes,
        Source::Paracord,
        Source::RocketMaterials,
        Source::FruityChutes,
        Source::PiaC1200,
        Source::PiaC2754d,
        Source::MilT8363b,
        Source::PiaW1100a,
        Source::Teijin,
        Source::TensionTechnology,
        Source::RopeFibres,
        Source::Paper,
        Source::Memory,
    ];

    /// What it is, where it was read and which part was read.
    pub fn text(self) -> &'static str {
        match self {
            Source::MilC7020h => {
                "MIL-C-7020H, 16 March 1992, section 1.2: weave and weight of the types. First pages read \
                 (vdocuments.net/mil-c-7020h-superseding-mil-c-7020g.html), not its Table I"
            }
            Source::Nakka => {
                "R. Nakka, parachute construction, table of commercial parachute cloths (nakka-rocketry.net/paralst.html): weight, \
                 thickness, strength and permeability of types of MIL-C-498E, MIL-C-7020H and MIL-C-44378"
            }
            Source::Mit => {
                "MIT Rocket Team, notes on parachute materials (wikis.mit.edu, page 158402807): permeability of MIL-C-7020 type III and \
                 F-111; nylon elongates at least 20 % by specification and 30 to 40 % in fact, Kevlar 5 %"
            }
            Source::Forchheimer => {
                "fit of a v + b v² to 48 points of MIL-C-7020 type III from 101 Pa upwards (R² 0.998; notes of a public repository on \
                 parachute permeability)"
            }
            Source::PiaC44378d => {
                "PIA-C-44378D (2007), section 1.2: weight, permeability. First page read (mydoc123.com/p-1016668.html)"
            }
            Source::Certificate => {
                "certificate of ten lots of PIA-C-44378E type IV, April 2025, in a public repository: limits of the specification and \
                 results by ASTM D3776, D1777, D5035 and D737"
            }
            Source::PiaC8021c => {
                "PIA-C-8021C (2013), section 1.2: weights of the types. First page read (mydoc123.com/p-1016677.html)"
            }
            Source::Spherachutes => {
                "parachutes of Spherachutes (2022), materials file for OpenRocket by H. C. Miller"
            }
            Source::Paracord => {
                "MIL-C-5040H type III as dewellton.com/Acessories.html and pipesmagazine.com (thread 16569) quote it"
            }
            Source::RocketMaterials => {
                "rocket materials in a public repository, which cites MIL-C-5040H, Table II"
            }
            Source::FruityChutes => {
                "parachutes of Fruity Chutes (2022), materials file for OpenRocket by H. C. Miller"
            }
            Source::PiaC1200 | Source::PiaC2754d | Source::MilT8363b | Source::PiaW1100a => self.first_page(),
            Source::Teijin => {
                "Teijin, tensile properties of industrial fibres, table 3 (teijin.com, page tech_bussei_hippari): density, elongation at break"
            }
            Source::TensionTechnology => {
                "Tension Technology, table 1, synthetic fibre yarn properties (tensiontech.cn): strength for each tex"
            }
            Source::RopeFibres => {
                "Radio Works, properties of fibers (radioworks.com/nrope1.html): elongation"
            }
            Source::Paper => {
                "the paper (see [references](../references.md)), as in `cases/atps-descent/scene.toml`"
            }
            Source::Memory => "from memory, not opened: compare it with the specification before use",
        }
    }

    /// A specification of which the first page was read.
    fn first_page(self) -> &'static str {
        match self {
            Source::PiaC1200 => {
                "PIA-C-1200 (2013), section 1.2: strengths of Spectra cord. First page read (mydoc123.com/p-1016654.html)"
            }
            Source::PiaC2754d => {
                "PIA-C-2754D (2015), section 1.2: feet for each pound of polyester cord. First page read (mydoc123.com/p-1016662.html)"
            }
            Source::MilT8363b => {
                "MIL-T-8363B (1974), section 1.2: strengths of nylon tapes and webbings. First page read (mydoc123.com/p-428665.html)"
            }
            _ => {
                "PIA-W-1100A (2012), section 1.3: widths and strengths of nylon webbing with tubular edges. First page read (mydoc123.com/p-1016733.html)"
            }
        }
    }

    /// Number on the page, from 1.
    pub fn number(self) -> usize {
        Source::ALL.iter().position(|s| *s == self).map_or(0, |i| i + 1)
    }
}
