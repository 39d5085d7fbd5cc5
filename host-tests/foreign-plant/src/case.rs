//! Definition of a case: its effects, runs, noise and conditions.

use crate::chamber::{Program, Span};
use crate::defects::Defects;
use crate::draw::stream;
use crate::noise::Noise;
use crate::physics::Form;
use crate::plan::{Followed, Plan};
use crate::truth::Class;
use rand::Rng;

/// Letters of the axes.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// Quantity on which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Acts {
    /// On the bias of an axis.
    OnBias,
    /// On what each axis' own thermometer indicates.
    OnThermometer,
    /// On all thermometers alike, by one scale.
    OnAllThermometers,
}

/// Size of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// In noise floors after equation 7, by axis; 0 for an axis without it. The unit's own spread of 10 % comes on top.
    Floors([f64; 3]),
    /// The form's own, times this scale by axis.
    Natural([f64; 3]),
}

/// Runs in which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runs {
    /// In all.
    All,
    /// In the train runs only.
    Train,
    /// In the verify run only.
    Verify,
}

/// One effect of a case.
#[derive(Clone, Debug)]
pub struct Effect {
    /// Name of its form.
    pub name: &'static str,
    /// Classes that name it rightly, its own first.
    pub classes: Vec<Class>,
    /// Classes that may be named beside a right one: parts of the form are of them.
    pub beside: Vec<Class>,
    /// Quantity on which it acts.
    pub acts: Acts,
    /// Its physics.
    pub form: Form,
    /// Its size.
    pub size: Size,
    /// Runs in which it acts.
    pub runs: Runs,
    /// Why a unit cannot take it off; None: it can.
    pub why_not: Option<&'static str>,
}

impl Effect {
    fn new(class: Class, name: &'static str, form: Form, acts: Acts) -> Self {
        let why_not = match class {
            Class::Event => Some("it cannot be foretold"),
            _ => None,
        };
        Self {
            name,
            classes: vec![class],
            beside: Vec::new(),
            acts,
            form,
            size: Size::Floors([3.0; 3]),
            runs: Runs::All,
            why_not,
        }
    }

    /// An effect on the bias, of 3 floors on each axis.
    #[must_use]
    pub fn bias(class: Class, name: &'static str, form: Form) -> Self {
        Self::new(class, name, form, Acts::OnBias)
    }

    /// A fault of each axis' thermometer.
    #[must_use]
    pub fn thermometer(name: &'static str, form: Form) -> Self {
        Self::new(Class::Thermometer, name, form, Acts::OnThermometer)
    }

    /// A fault that all thermometers share.
    #[must_use]
    pub fn timebase(name: &'static str, form: Form) -> Self {
        Self::new(Class::Thermometer, name, form, Acts::OnAllThermometers)
    }

    /// Sizes in floors, by axis.
    #[must_use]
    pub fn floors(mut self, floors: [f64; 3]) -> Self {
        self.size = Size::Floors(floors);
        self
    }

    /// The form's own size, times `scale` by axis.
    #[must_use]
    pub fn natural(mut self, scale: [f64; 3]) -> Self {
        self.size = Size::Natural(scale);
        self
    }

    /// Other classes that name it as rightly.
    #[must_use]
    pub fn or(mut self, classes: &[Class]) -> Self {
        self.classes.extend_from_slice(classes);
        self
    }

    /// Classes of which the form has parts: they may be named beside a right one.
    #[must_use]
    pub fn beside(mut self, classes: &[Class]) -> Self {
        self.beside.extend_from_slice(classes);
        self
    }

    /// Acts in these runs only.
    #[must_use]
    pub fn only(mut self, runs: Runs) -> Self {
        self.runs = runs;
        self
    }

    /// A unit cannot take it off, for this reason.
    #[must_use]
    pub fn beyond(mut self, why_not: &'static str) -> Self {
        self.why_not = Some(why_not);
        self
    }

    /// `true` if axis number `axis` has it.
    #[must_use]
    pub fn on(&self, axis: usize) -> bool {
        match self.size {
            Size::Floors(sizes) | Size::Natural(sizes) => sizes[axis] != 0.0,
        }
    }
}

/// Columns and metadata of the files.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Axes in the file.
    pub axes: Vec<usize>,
    /// Body that the bias follows and the thermometer shows.
    pub followed: Followed,
    /// Step of the frequency, Hz; 0: fine.
    pub frequency_step_hz: f64,
    /// Case sensors recorded.
    pub cases: bool,
    /// Case columns under their old name, `shell_?_c`.
    pub old_names: bool,
    /// Chamber's air recorded.
    pub chamber: bool,
    /// Board recorded.
    pub board: bool,
    /// Supply, drive and quadrature recorded.
    pub electrics: bool,
    /// Drive and quadrature come of losses and stiffness, behind loops.
    pub losses: bool,
    /// A fault of the case sensor of x that leaves the frequency as it is: it comes loose in the train run.
    pub loose_case_x: bool,
    /// Latitude and axes stated, and the earth's rate in the rates.
    pub earth: bool,
    /// No time column; `time_step_s` in the metadata.
    pub untimed: bool,
    /// Columns in another order, with one that nobody knows.
    pub shuffled: bool,
    /// Time from row to row, s.
    pub row_s: f64,
}

/// One run of a case.
#[derive(Clone, Copy, Debug)]
pub struct RunSpec {
    /// Plan of the run.
    pub plan: Plan,
    /// Defects put into its file.
    pub defects: Option<Defects>,
}

/// Changes from day to day.
#[derive(Clone, Copy, Debug)]
pub struct Days {
    /// Deviation of each run's constant, floors.
    pub constant_floors: f64,
    /// A change of slope in the verify run: deviation over that run, floors.
    pub slope_floors: f64,
}

/// A named case.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// Description in a sentence.
    pub description: String,
    /// A class's name, `mixture`, `condition` or `clean`.
    pub group: &'static str,
    /// Effects.
    pub effects: Vec<Effect>,
    /// Train runs, one or more.
    pub trains: Vec<RunSpec>,
    /// The verify run.
    pub verify: RunSpec,
    /// Runs behind the one that judges, which no effect is sized by.
    pub more: Vec<RunSpec>,
    /// Kind of noise.
    pub noise: Noise,
    /// Noise floors are drawn from this range, deg/h.
    pub floors_dph: (f64, f64),
    /// Bias of equation 7 over the widest run, three sigma, is drawn from this range, deg/h.
    pub raw_three_sigma_dph: (f64, f64),
    /// Changes from day to day.
    pub days: Days,
    /// Columns and metadata.
    pub layout: Layout,
    /// Why a unit cannot reach the oracle, where a condition of the runs forbids it.
    pub why_not: Option<&'static str>,
    /// Right answers beside those of the effects.
    pub also_right: Vec<Class>,
}

/// Temperatures of a full run.
pub const FULL: Span = Span { low_c: -42.0, high_c: 55.0, start_c: 22.0 };

/// A run of the given program, with full span.
#[must_use]
pub fn run(program: Program, hours: f64) -> RunSpec {
    RunSpec {
        plan: Plan { program, span: FULL, hours, log_from_s: 0.0, branch: 1.0, kept_c: 0.0, legs: &[] },
        defects: None,
    }
}

impl Case {
    /// A case with usual runs: 7 h to train, 10 h to verify, of different programs that hang on the name.
    #[must_use]
    pub fn new(group: &'static str, name: &str, description: &str) -> Self {
        use Program::{Cycles, SawSweep, SetpointWalk, ShrinkingLoops, Stairs, TwoSpeed};
        let programs = [Cycles, Stairs, TwoSpeed, SetpointWalk, ShrinkingLoops, SawSweep];
        let mut rng = stream(0, &["programs", name]);
        let train = rng.random_range(0..programs.len());
        let other = (train + rng.random_range(1..programs.len())) % programs.len();
        Self {
            name: name.into(),
            description: description.into(),
            group,
            effects: Vec::new(),
            trains: vec![run(programs[train], 7.0)],
            verify: run(programs[other], 10.0),
            more: Vec::new(),
            noise: Noise::Usual,
            floors_dph: (0.1, 0.5),
            raw_three_sigma_dph: (5.2, 9.8),
            days: Days { constant_floors: 0.5, slope_floors: 0.0 },
            layout: Layout {
                axes: vec![0, 1, 2],
                followed: Followed::Resonator,
                frequency_step_hz: 0.0,
                cases: true,
                old_names: false,
                chamber: true,
                board: rng.random_bool(0.4),
                electrics: rng.random_bool(0.3),
                losses: false,
                loose_case_x: false,
                earth: false,
                untimed: false,
                shuffled: false,
                row_s: 1.0,
            },
            why_not: None,
            also_right: Vec::new(),
        }
    }

    /// Adds an effect.
    #[must_use]
    pub fn with(mut self, effect: Effect) -> Self {
        self.effects.push(effect);
        self
    }

    /// Sets the programs of the (first) train run and of the verify run.
    #[must_use]
    pub fn programs(mut self, train: Program, verify: Program) -> Self {
        self.trains[0].plan.program = train;
        self.verify.plan.program = verify;
        self
    }

    /// Adds a train run.
    #[must_use]
    pub fn and_train(mut self, run: RunSpec) -> Self {
        self.trains.push(run);
        self
    }

    /// Changes each train run.
    #[must_use]
    pub fn each_train(mut self, change: impl Fn(&mut RunSpec)) -> Self {
        self.trains.iter_mut().for_each(change);
        self
    }

    /// Changes the verify run.
    #[must_use]
    pub fn verify_with(mut self, change: impl Fn(&mut RunSpec)) -> Self {
        change(&mut self.verify);
        self
    }

    /// Changes columns and metadata.
    #[must_use]
    pub fn layout(mut self, change: impl Fn(&mut Layout)) -> Self {
        change(&mut self.layout);
        self
    }

    /// Sets the noise.
    #[must_use]
    pub fn noise(mut self, noise: Noise) -> Self {
        self.noise = noise;
        self
    }

    /// Sets the range of noise floors, deg/h.
    #[must_use]
    pub fn quiet(mut self, from: f64, to: f64) -> Self {
        self.floors_dph = (from, to);
        self
    }

    /// Sets the changes from day to day, floors.
    #[must_use]
    pub fn days(mut self, constant_floors: f64, slope_floors: f64) -> Self {
        self.days = Days { constant_floors, slope_floors };
        self
    }

    /// The verify run cannot be compensated, for this reason.
    #[must_use]
    pub fn beyond(mut self, why_not: &'static str) -> Self {
        self.why_not = Some(why_not);
        self
    }

    /// A right answer beside those of the effects.
    #[must_use]
    pub fn also(mut self, class: Class) -> Self {
        self.also_right.push(class);
        self
    }

    /// A third run, which judges what train and verify run have chosen: as the verify run, by another program.
    #[must_use]
    pub fn judge(&self) -> RunSpec {
        use Program::{Cycles, SawSweep, SetpointWalk, ShrinkingLoops, Stairs, TwoSpeed};
        let flown = |p: &Program| self.trains.iter().chain([&self.verify]).any(|r| r.plan.program == *p);
        let others = [Cycles, Stairs, TwoSpeed, SetpointWalk, ShrinkingLoops, SawSweep].into_iter();
        let others: Vec<Program> = others.filter(|p| !flown(p)).collect();
        let chosen = stream(0, &["judge", &self.name]).random_range(0..others.len());
        RunSpec { plan: Plan { program: others[chosen], hours: 8.0, ..self.verify.plan }, defects: None }
    }

    /// Runs in the order of generation: train runs, the verify run, the run that judges, and those that nothing is sized by.
    pub fn runs(&self) -> impl Iterator<Item = RunSpec> + '_ {
        self.trains.iter().copied().chain([self.verify, self.judge()]).chain(self.more.iter().copied())
    }

    /// Classes of a right answer: of the first effect first; `none` for a case without effects.
    #[must_use]
    pub fn classes(&self) -> Vec<Class> {
        let primary = self.effects.iter().filter_map(|e| e.classes.first());
        let equivalent = self.effects.iter().flat_map(|e| e.classes.iter().skip(1));
        let mut classes: Vec<Class> = Vec::new();
        for &class in primary.chain(equivalent) {
            if !classes.contains(&class) {
                classes.push(class);
            }
        }
        if self.effects.is_empty() {
            classes.push(Class::None);
        }
        classes.extend(&self.also_right);
        classes
    }

    /// Classes that may be named beside a right one, and are no right answer alone.
    #[must_use]
    pub fn beside(&self) -> Vec<Class> {
        let right = self.classes();
        let mut beside: Vec<Class> = self.effects.iter().flat_map(|e| e.beside.iter().copied()).collect();
        beside.sort_unstable();
        beside.dedup();
        beside.retain(|class| !right.contains(class));
        beside
    }

    /// Reason why a unit cannot reach the oracle on the verify run; `None`: it can.
    #[must_use]
    pub fn why_not_compensable(&self) -> Option<&'static str> {
        self.why_not.or_else(|| self.effects.iter().find_map(|e| e.why_not))
    }
}
