//! The unit's maths on the desktop, fed with the time stamps and codes that the unit was fed with.
//!
//! The same `hrg_core`, compiled for the desktop. Every frame that the ELF sends must equal, byte for byte, the one
//! that comes out here.

use hrg_align::linear::Linear;
use hrg_align::session::Session;
use hrg_core::adc::{Dialogue, WORDS};
use hrg_core::align_mode::{AlignMode, Command, NotBuiltIn};
use hrg_core::calibration::Calibration;
use hrg_core::chip::Factory;
use hrg_core::compensator::Output;
use hrg_core::frequency::{Config, CounterBank, StepFrequencies, GATES_PER_STEP};
use hrg_core::gnss::GnssClock;
use hrg_core::history::{History, Settling};
use hrg_core::inputs::{Channel, InputBank, CHIP_C, CHIP_V};
use hrg_core::link::{Deframer, Identity, InputsUsed, Message};
use hrg_core::maintenance;
use hrg_core::output::OutputSettings;
use hrg_core::parts::Parts;
use hrg_core::pps::{self, Pps};
use hrg_core::rate_output::RateOutput;
use hrg_core::rate_path::{PendingBias, RatePath};
use hrg_core::sensors::{with_readings, Platinum, SensorBank, Window};
use hrg_core::status::UnitStatus;
use hrg_core::telemetry::Telemetry;
use hrg_core::timebase::Timebase;
use hrg_data::recording::steps::Steps;
use hrg_identify::fit::correct::{ModelOf, Stepped};
use std::collections::VecDeque;
use virtual_board::chip_adc::{Ambient, FACTORY};
use virtual_board::CYCLES_PER_TICK;

/// Supply and temperature of the processor as its ADC shows them.
fn measured(ambient: Ambient) -> Option<(f32, f32)> {
    let [reference, at_30_c, at_110_c] = FACTORY;
    let [of_reference, of_thermometer] = ambient.codes();
    let codes = [of_reference, of_thermometer, of_thermometer, of_thermometer];
    Factory { reference, at_30_c, at_110_c }.values(codes)
}

/// Supply and temperature of the processor in each second of a recording; those of the board where it has none.
#[must_use]
pub fn ambient(steps: &Steps, second: usize) -> Ambient {
    let given = steps.given(second);
    let [temperature_c, supply_v] = [CHIP_C, CHIP_V].map(|number| f64::from(given.get(number)));
    let usual = Ambient::default();
    Ambient {
        supply_v: if supply_v.is_finite() { supply_v } else { usual.supply_v },
        temperature_c: if temperature_c.is_finite() { temperature_c } else { usual.temperature_c },
    }
}

/// The bias model of a unit, by the past that it was built with.
enum Model {
    Past(Box<ModelOf<History>>),
    Settling(Box<ModelOf<Settling>>),
}

/// Calls the same method of either model.
macro_rules! either {
    ($model:expr, $m:ident => $call:expr) => {
        match $model {
            Model::Past($m) => $call,
            Model::Settling($m) => $call,
        }
    };
}

/// The digital twin of one power-on.
pub struct Twin {
    timebase: Timebase,
    bank: CounterBank,
    pps: Pps,
    model: Model,
    adc: Dialogue,
    /// Channels 5 to 7 of the ADC, where the firmware reads them (temperature sensors in the place of resonators, or inputs), and their
    /// last second.
    sensors: Option<(SensorBank, Option<Window>)>,
    /// Inputs beside the frequencies, where the firmware takes them; and those at the ADC.
    inputs: Option<InputBank>,
    aux: bool,
    output: RateOutput,
    telemetry: Telemetry<Box<dyn AlignMode + Send>>,
    now: u64,
    steps: VecDeque<(StepFrequencies, Output, pps::Report)>,
    link: VecDeque<(u64, u8)>,
    deframer: Deframer,
    commands: Vec<Command>,
    /// Reports of an alignment that the unit owes.
    pub alignment: VecDeque<Message>,
    /// Rate frames that the unit owes.
    pub rates: VecDeque<Message>,
    /// Housekeeping that the unit owes.
    pub housekeeping: VecDeque<Message>,
    /// Messages of the inputs used that the unit owes.
    pub inputs_used: VecDeque<Message>,
    /// Increments that the unit owes.
    pub increments: VecDeque<Message>,
    /// Pulses in GNSS time that the unit owes.
    pub marks: VecDeque<Message>,
    gnss: GnssClock,
    /// Of the processor, by second.
    ambient: Vec<Ambient>,
}

impl Twin {
    /// `start_status`: status of the unit from start-up (default calibration). `parts`: those that the firmware was built with.
    #[must_use]
    pub fn new(calibration: Calibration, start_status: UnitStatus, parts: Parts) -> Self {
        Self::at(Timebase::REFERENCE, calibration, start_status, parts)
    }

    /// The same with a timer of another rate.
    #[must_use]
    pub fn at(timebase: Timebase, calibration: Calibration, start_status: UnitStatus, parts: Parts) -> Self {
        let mut session: Box<dyn AlignMode + Send> = if parts.contains(Parts::ALIGN) {
            Box::new(Session::<Linear<f32>>::IDLE)
        } else {
            Box::new(NotBuiltIn::IDLE)
        };
        session.set_accelerometers(calibration.accelerometers);
        let settings = OutputSettings::default();
        // (Three accelerometers, or two where channels 5 to 7 are other things: `with_sensors`.)
        let accelerometers = if parts.contains(Parts::AUX) { 2 } else { 3 };
        let path = RatePath::new(timebase, calibration.scale_factors_dph_per_code(), settings.decimation)
            .with_output(settings, accelerometers);
        let default = start_status.contains(UnitStatus::DEFAULT_CALIBRATION);
        let identity = Identity {
            unit: calibration.unit,
            calibration: if default { 0 } else { calibration.checksum() },
            created_unix_s: calibration.created_unix_s,
            sequence: calibration.sequence,
            ..Identity::default()
        };
        Self {
            timebase,
            bank: CounterBank::new(Config::at(timebase), GATES_PER_STEP),
            pps: Pps::new(timebase),
            model: if parts.contains(Parts::PAST) {
                Model::Past(Box::new(ModelOf::new(calibration, 0.0)))
            } else {
                Model::Settling(Box::new(ModelOf::new(calibration, 0.0)))
            },
            adc: Dialogue::default(),
            sensors: parts.contains(Parts::AUX).then(|| (SensorBank::new(timebase), None)),
            inputs: parts.contains(Parts::INPUTS).then(InputBank::default),
            aux: parts.contains(Parts::AUX),
            output: RateOutput::new(path, start_status),
            telemetry: Telemetry::new(session, timebase, identity, start_status),
            link: VecDeque::new(),
            deframer: Deframer::default(),
            commands: Vec::new(),
            alignment: VecDeque::new(),
            now: 0,
            steps: VecDeque::new(),
            rates: VecDeque::new(),
            housekeeping: VecDeque::new(),
            inputs_used: VecDeque::new(),
            increments: VecDeque::new(),
            marks: VecDeque::new(),
            gnss: GnssClock::new(timebase),
            ambient: Vec::new(),
        }
    }

    /// With the supply and temperature of the processor that a recording has.
    #[must_use]
    pub fn with_ambient(mut self, steps: &Steps) -> Self {
        self.ambient = (0..steps.len()).map(|second| ambient(steps, second)).collect();
        self
    }

    /// Of a firmware that is built with the feature sensors.
    #[must_use]
    pub fn with_sensors(mut self) -> Self {
        self.sensors = Some((SensorBank::new(self.timebase), None));
        self.output.set_accelerometers(2);
        self
    }

    /// Has the model go on from states that were kept before a reset. Before anything else.
    ///
    /// # Errors
    /// Words that are not intact.
    pub fn resume(&mut self, words: &[u32]) -> Result<(), hrg_data::error::BadInput> {
        either!(&mut self.model, m => m.resume(words))?;
        self.telemetry.set_resets(either!(&self.model, m => m.resets()));
        Ok(())
    }

    /// The states as the unit keeps them after its last step.
    pub fn keep(&mut self) -> Vec<u32> {
        either!(&mut self.model, m => m.keep())
    }

    /// Time goes on to a timer reading: closes gates that are over.
    fn advance(&mut self, stamp: u32) {
        let ahead = stamp.wrapping_sub(self.now as u32) as i32;
        if ahead > 0 {
            self.now += u64::from(ahead.unsigned_abs());
        }
        while self.now > self.bank.close_tick() {
            let at = self.bank.close_tick();
            if let Some(step) = self.bank.poll(at as u32) {
                let (mut step, report) = self.pps.second(step);
                self.hear();
                self.marks.extend(self.gnss.mark(at as u32, self.pps.correction()).map(Message::TimeMark));
                let window = self.sensors.as_mut().and_then(|(_, window)| window.take());
                if self.sensors.is_some() && !self.aux {
                    step = with_readings(step, window.as_ref(), &Platinum::PT1000);
                }
                self.hear();
                if let Some(bank) = &mut self.inputs {
                    // (Begun behind the step before: in this second.)
                    let ambient = self.ambient.get(step.step as usize).copied().unwrap_or_default();
                    if let Some((supply_v, temperature_c)) = measured(ambient) {
                        bank.set(CHIP_C, temperature_c);
                        bank.set(CHIP_V, supply_v);
                    }
                    if let Some(window) = window.filter(|w| self.aux && w.step == step.step) {
                        bank.take(&window, &Channel::DRIVES);
                    }
                    let values = bank.step();
                    either!(&mut self.model, m => m.set_inputs(values));
                    if bank.any() {
                        let used = InputsUsed { step: step.step, values: *values.values() };
                        self.inputs_used.push_back(Message::InputsUsed(used));
                    }
                }
                let Stepped { output, .. } = either!(&mut self.model, m => m.step(&step));
                self.output.set_bias(PendingBias::new(self.timebase, &step, &output));
                self.steps.push_back((step, output, report));
            }
        }
    }

    /// An edge was captured.
    pub fn captured(&mut self, channel: usize, stamp: u32) {
        self.advance(stamp);
        self.bank.push(channel, [stamp]);
    }

    /// A pulse per second was captured.
    pub fn pulsed(&mut self, stamp: u32) {
        self.advance(stamp);
        self.pps.pulse(stamp);
        self.gnss.pulse(stamp);
    }

    /// A byte arrives at the unit, at a time in cycles.
    pub fn link_in(&mut self, cycles: u64, byte: u8) {
        self.link.push_back((cycles, byte));
    }

    /// The messages that have arrived by now: inputs count at once, the commands of an alignment wait for the second's end.
    fn hear(&mut self) {
        while let Some(&(_, byte)) = self.link.front().filter(|(at, _)| at / CYCLES_PER_TICK <= self.now) {
            self.link.pop_front();
            match self.deframer.push(byte) {
                Some(Ok(Message::Align(command))) => self.commands.push(command),
                Some(Ok(Message::GnssTime(time))) => self.gnss.set(time, self.now as u32),
                Some(Ok(Message::Maintain(maintenance::Command::Output(settings)))) => self.output.set_output(settings),
                Some(Ok(Message::Inputs(values))) => self.inputs.iter_mut().for_each(|bank| bank.receive(&values)),
                _ => {}
            }
        }
    }

    /// The commands of an alignment that have arrived by now.
    fn commands(&mut self) {
        self.hear();
        for command in std::mem::take(&mut self.commands) {
            if let Some(trim) = self.telemetry.align(command) {
                either!(&mut self.model, m => m.set_trim(trim));
            }
        }
    }

    /// An ADC frame was fetched.
    pub fn fetched(&mut self, stamp: u32, frame: &[u8]) {
        self.advance(stamp);
        let byte = |n: usize| frame.get(n).copied().unwrap_or(0);
        let words: [u32; WORDS] = std::array::from_fn(|k| u32::from_le_bytes([0, 1, 2, 3].map(|n| byte(4 * k + n))));
        let received = self.adc.receive(&words, false);
        let Some(codes) = received.sample() else { return };
        if let Some((bank, window)) = self.sensors.as_mut().filter(|_| codes.is_ok()) {
            *window = bank.push(stamp, received.sensors()).or(*window);
        }
        self.hear();
        let rates = &mut self.rates;
        let send = |frame| {
            rates.push_back(Message::Rate(frame));
            true
        };
        // The digital twin's memory does not change by itself, and its queue takes everything.
        let second = self.output.sample(stamp, codes, send);
        self.increments.extend(self.output.increments().map(Message::Increments));
        let Ok(Some(second)) = second else { return };
        self.commands();
        if let Some((step, output, report)) = self.steps.pop_front() {
            self.telemetry.set_pps(report);
            let (housekeeping, report) = self.telemetry.second(&step, &output, Some(&second));
            self.alignment.extend(report.map(Message::Alignment));
            self.housekeeping.push_back(Message::Housekeeping(housekeeping));
        }
    }
}
