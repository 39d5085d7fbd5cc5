//! The coefficient block: what the desktop identifies and the unit keeps in flash.
//!
//! # Layout (little-endian)
//! `magic "HRGC"`, `version u16`, `length u16` (of the whole block, checksum included), payload, `CRC-32` (ISO-HDLC)
//! of all before it. The payload is written and read by one pair of functions in this file, in one order.
//! Effects are named by the stable numbers of [`crate::effects`], so an old block loads in a new firmware; a new
//! block with an effect that an old firmware lacks is refused by name of error, never half used.
//!
//! Every number is checked when a block is read: a block with a valid checksum and an absurd number is as
//! useless as a broken one.

use crate::bias::four_parameter::FourParameter;
use crate::bias::{Coefficients, Scaling, TERMS};
use crate::bytes::{crc32, Reader, Writer};
use crate::effects::{shape, Shape, MAX_OUTPUTS, MAX_PARAMETERS};
use crate::temperature::TemperatureLaw;
use crate::AXES;
use heapless::Vec;

/// First bytes of every block.
pub const MAGIC: [u8; 4] = *b"HRGC";
/// Version of the layout.
pub const VERSION: u16 = 1;
/// Most effects in one block.
pub const MAX_EFFECTS: usize = 6;
/// Longest possible block in bytes.
pub const MAX_BYTES: usize = 2048;
/// Bytes before the payload.
const HEADER: usize = 8;
/// Any coefficient beyond this is not one of a gyro (deg/h, C, Hz and their ratios).
const ABSURD: f32 = 1e7;

/// One axis of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Frequency to temperature.
    pub law: TemperatureLaw,
    /// Scale factor of the rate channel, deg/h per code of the ADC; its sign is that of the channel.
    pub scale_factor_dph_per_code: f32,
    /// Range of dT/dt in the data of the fit, C per minute.
    pub rate_range_c_per_min: [f32; 2],
    /// The baseline model.
    pub coefficients: Coefficients,
    /// Standard deviation of each coefficient, row after row: cooling then heating set, or the linear coefficients of
    /// another model in their order (zeros: not stated).
    pub coefficient_std: [[f32; TERMS]; 2],
    /// Standard deviation of 100 s means of the compensated rate in the training data, deg/h (0: not stated).
    pub train_rms_dph: f32,
    /// The same on a run that the fit never saw, deg/h (0: not measured).
    pub verify_rms_dph: f32,
}

/// One effect of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectTerm {
    /// Number of the effect.
    pub id: u16,
    /// Inner parameters, common to the axes.
    pub parameters: [f32; MAX_PARAMETERS],
    /// Gain of each regressor on each axis, deg/h per unit of the regressor.
    pub gains: [[f32; MAX_OUTPUTS]; AXES],
    /// Standard deviations of the gains.
    pub gain_std: [[f32; MAX_OUTPUTS]; AXES],
}

/// A calibration: all that makes a unit's numbers that unit's.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Name of the unit, ASCII, zero-padded.
    pub unit: [u8; 16],
    /// When it was made, seconds since 1970 (0: the compiled-in default).
    pub created_unix_s: u32,
    /// Counts up with each block burnt; the newest valid block wins.
    pub sequence: u32,
    /// CRC-32 of the recordings that made it.
    pub data_hash: u32,
    /// False for the compiled-in default: rates are flagged uncalibrated.
    pub calibrated: bool,
    /// Centre and scale of the bias model.
    pub scaling: Scaling,
    /// The axes.
    pub axes: [Axis; AXES],
    /// Effects beyond the baseline.
    pub effects: Vec<EffectTerm, MAX_EFFECTS>,
}

/// Why a block was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BlockError {
    /// The flash is erased (or there is nothing at all).
    NoBlock,
    /// It does not begin as a block does, and is not erased either.
    Foreign,
    /// It is of another version.
    Version(u16),
    /// Its length is impossible, or more than there is.
    Length(u16),
    /// Its checksum does not match.
    Checksum,
    /// A number is NaN or infinite.
    NotFinite,
    /// A number is impossible for a gyro (which: see the name).
    Absurd(&'static str),
    /// Its bias model is of a kind that this firmware does not know.
    UnknownModel(u8),
    /// It holds an effect that this firmware does not know.
    UnknownEffect(u16),
    /// It holds an effect that this unit cannot compute.
    NotOnUnit(u16),
}

impl core::fmt::Display for BlockError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoBlock => write!(f, "there is no calibration block"),
            Self::Foreign => write!(f, "what is there does not begin as a calibration block does"),
            Self::Version(v) => write!(f, "the block is of version {v}, this program reads version {VERSION}"),
            Self::Length(n) => write!(f, "the block's length of {n} bytes is impossible"),
            Self::Checksum => write!(f, "the block's checksum does not match its content"),
            Self::NotFinite => write!(f, "the block holds a number that is not finite"),
            Self::Absurd(what) => write!(f, "the block's {what} is impossible"),
            Self::UnknownModel(kind) => {
                write!(f, "the block's bias model is of kind {kind}, which this program does not know")
            }
            Self::UnknownEffect(id) => {
                write!(f, "the block holds effect number {id}, which this program does not know")
            }
            Self::NotOnUnit(id) => write!(f, "the block holds effect number {id}, which a unit cannot compute"),
        }
    }
}

impl core::error::Error for BlockError {}

impl Calibration {
    /// What a unit runs that was never calibrated: the frequency laws of dong2023's Table 1 and no bias.
    ///
    /// The laws are the centred cubic fits of that table on its shell sensors; `hrg points
    /// host-tests/recordings/dong2023-table1.csv` prints them and a host test compares.
    #[must_use]
    pub fn uncalibrated() -> Self {
        let law = |f0_hz, scale_hz, c, min_c, max_c| TemperatureLaw { f0_hz, scale_hz, c, min_c, max_c };
        let laws = [
            law(4900.0, 21.152, [9.218_105, 44.580_624, 1.161_163_1, 0.166_985_72], -34.374, 55.128),
            law(4891.9745, 20.227_5, [7.768_591_4, 44.597_454, 1.129_869, 0.170_522_93], -35.865, 53.673),
            law(4703.596, 19.444, [7.809_050_6, 44.658_787, 1.113_637_7, 0.114_508_46], -35.849, 53.708),
        ];
        Self {
            unit: UNNAMED,
            created_unix_s: 0,
            sequence: 0,
            data_hash: 0,
            calibrated: false,
            scaling: Scaling {
                t_ref_c: 10.0,
                t_scale_c: 45.0,
                t_linear_c: [-45.0, 65.0],
                r_linear: 10.0,
                blend_band: 0.1,
            },
            axes: laws.map(|law| Axis {
                law,
                scale_factor_dph_per_code: DEFAULT_SCALE_FACTOR,
                rate_range_c_per_min: [-10.0, 10.0],
                coefficients: Coefficients::One([0.0; TERMS]),
                coefficient_std: [[0.0; TERMS]; 2],
                train_rms_dph: 0.0,
                verify_rms_dph: 0.0,
            }),
            effects: Vec::new(),
        }
    }

    /// The unit's name as text.
    #[must_use]
    pub fn unit_name(&self) -> &str {
        unit_text(&self.unit)
    }

    /// Scale factor of each axis, deg/h per code.
    #[must_use]
    pub fn scale_factors_dph_per_code(&self) -> [f32; AXES] {
        [0, 1, 2].map(|a: usize| self.axes[a].scale_factor_dph_per_code)
    }

    /// Sets the name; longer than 16 bytes is cut.
    pub fn set_unit_name(&mut self, name: &str) {
        self.unit = [0; 16];
        for (to, from) in self.unit.iter_mut().zip(name.bytes().filter(u8::is_ascii_graphic)) {
            *to = from;
        }
    }

    /// The block, ready for flash. `None` cannot happen for a value that [`from_bytes`](Self::from_bytes) gave.
    #[must_use]
    pub fn to_bytes(&self) -> Option<Vec<u8, MAX_BYTES>> {
        let mut buffer = [0u8; MAX_BYTES];
        let mut w = Writer::new(&mut buffer);
        w.bytes(&MAGIC);
        w.u16(VERSION);
        w.u16(0);
        self.write_payload(&mut w);
        let payload_end = w.finish()?;
        let length = payload_end + 4;
        if length > MAX_BYTES {
            return None;
        }
        buffer[6..8].copy_from_slice(&(length as u16).to_le_bytes());
        let crc = crc32(&buffer[..payload_end]);
        buffer[payload_end..length].copy_from_slice(&crc.to_le_bytes());
        Vec::from_slice(&buffer[..length]).ok()
    }

    /// Reads a block; `bytes` may be longer than the block (a whole flash sector).
    ///
    /// # Errors
    /// Each defect has its own [`BlockError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BlockError> {
        let mut header = Reader::new(bytes);
        if header.array::<4>() != Some(MAGIC) {
            // An erased sector holds no fault; a block whose first bytes are upset does.
            let erased = bytes.iter().take(MAX_BYTES).all(|b| *b == 0xFF);
            return Err(if erased { BlockError::NoBlock } else { BlockError::Foreign });
        }
        let version = header.u16().ok_or(BlockError::Length(0))?;
        let length = header.u16().ok_or(BlockError::Length(0))?;
        if version != VERSION {
            return Err(BlockError::Version(version));
        }
        let n = usize::from(length);
        if !(HEADER + 4..=MAX_BYTES).contains(&n) || n > bytes.len() {
            return Err(BlockError::Length(length));
        }
        let (content, crc) = bytes[..n].split_at(n - 4);
        if crc != crc32(content).to_le_bytes() {
            return Err(BlockError::Checksum);
        }
        let mut payload = Reader::new(&content[HEADER..]);
        let mut calibration = Self::uncalibrated();
        calibration.read_payload(&mut payload).ok_or(BlockError::Length(length))??;
        if payload.remaining() != 0 {
            return Err(BlockError::Length(length));
        }
        calibration.check()?;
        Ok(calibration)
    }

    /// The block's checksum: its identity in housekeeping and log.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let Some(bytes) = self.to_bytes() else {
            return 0;
        };
        let end = bytes.len() - 4;
        u32::from_le_bytes([bytes[end], bytes[end + 1], bytes[end + 2], bytes[end + 3]])
    }

    fn write_payload(&self, w: &mut Writer<'_>) {
        w.bytes(&self.unit);
        w.u32(self.created_unix_s);
        w.u32(self.sequence);
        w.u32(self.data_hash);
        w.u8(u8::from(self.calibrated));
        let s = &self.scaling;
        w.f32s(&[s.t_ref_c, s.t_scale_c, s.t_linear_c[0], s.t_linear_c[1], s.r_linear, s.blend_band]);
        for a in &self.axes {
            w.f64(a.law.f0_hz);
            w.f32(a.law.scale_hz);
            w.f32s(&a.law.c);
            w.f32s(&[a.law.min_c, a.law.max_c, a.scale_factor_dph_per_code]);
            w.f32s(&a.rate_range_c_per_min);
            match &a.coefficients {
                Coefficients::One(k) => {
                    w.u8(1);
                    w.f32s(k);
                }
                Coefficients::CoolingHeating(cooling, heating) => {
                    w.u8(2);
                    w.f32s(cooling);
                    w.f32s(heating);
                }
                Coefficients::FourParameter(m) => {
                    w.u8(3);
                    w.f32s(&m.k);
                    w.f32s(&[m.breakpoint_c, m.origin_c]);
                }
                Coefficients::Direct(k) => {
                    w.u8(4);
                    w.f32s(k);
                }
                Coefficients::Network(weights) => {
                    w.u8(5);
                    w.f32s(weights);
                }
            }
            w.f32s(&a.coefficient_std[0]);
            w.f32s(&a.coefficient_std[1]);
            w.f32s(&[a.train_rms_dph, a.verify_rms_dph]);
        }
        w.u8(self.effects.len() as u8);
        for e in &self.effects {
            let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs);
            w.u16(e.id);
            w.u8(outputs as u8);
            w.f32s(&e.parameters);
            for (g, s) in e.gains.iter().zip(&e.gain_std) {
                w.f32s(&g[..outputs]);
                w.f32s(&s[..outputs]);
            }
        }
    }

    /// Reads what lies in a block; `None` where it is too short.
    #[inline(never)]
    fn read_payload(&mut self, r: &mut Reader<'_>) -> Option<Result<(), BlockError>> {
        self.unit = r.array()?;
        self.created_unix_s = r.u32()?;
        self.sequence = r.u32()?;
        self.data_hash = r.u32()?;
        self.calibrated = r.u8()? != 0;
        let s: [f32; 6] = r.f32s()?;
        self.scaling =
            Scaling { t_ref_c: s[0], t_scale_c: s[1], t_linear_c: [s[2], s[3]], r_linear: s[4], blend_band: s[5] };
        for a in &mut self.axes {
            let f0_hz = r.f64()?;
            let scale_hz = r.f32()?;
            let c = r.f32s()?;
            let [min_c, max_c, scale_factor_dph_per_code] = r.f32s()?;
            a.law = TemperatureLaw { f0_hz, scale_hz, c, min_c, max_c };
            a.scale_factor_dph_per_code = scale_factor_dph_per_code;
            a.rate_range_c_per_min = r.f32s()?;
            a.coefficients = match r.u8()? {
                1 => Coefficients::One(r.f32s()?),
                2 => {
                    let cooling = r.f32s()?;
                    Coefficients::CoolingHeating(cooling, r.f32s()?)
                }
                3 => {
                    let k = r.f32s()?;
                    let [breakpoint_c, origin_c] = r.f32s()?;
                    Coefficients::FourParameter(FourParameter { k, breakpoint_c, origin_c })
                }
                4 => Coefficients::Direct(r.f32s()?),
                5 => Coefficients::Network(r.f32s()?),
                kind => return Some(Err(BlockError::UnknownModel(kind))),
            };
            a.coefficient_std = [r.f32s()?, r.f32s()?];
            [a.train_rms_dph, a.verify_rms_dph] = r.f32s()?;
        }
        self.effects.clear();
        for _ in 0..r.u8()? {
            let id = r.u16()?;
            let Some(Shape { outputs, .. }) = shape(id) else {
                return Some(Err(BlockError::UnknownEffect(id)));
            };
            if usize::from(r.u8()?) != outputs {
                return Some(Err(BlockError::Absurd("number of gains of an effect")));
            }
            let mut e = EffectTerm {
                id,
                parameters: r.f32s()?,
                gains: [[0.0; MAX_OUTPUTS]; AXES],
                gain_std: [[0.0; MAX_OUTPUTS]; AXES],
            };
            for (gains, std) in e.gains.iter_mut().zip(&mut e.gain_std) {
                r.fill(&mut gains[..outputs])?;
                r.fill(&mut std[..outputs])?;
            }
            if self.effects.push(e).is_err() {
                return Some(Err(BlockError::Absurd("number of effects")));
            }
        }
        Some(Ok(()))
    }

    /// Whether every number is finite and possible, and every effect one that a unit can compute.
    ///
    /// # Errors
    /// The first defect found.
    pub fn check(&self) -> Result<(), BlockError> {
        let s = &self.scaling;
        finite(&[s.t_ref_c, s.t_scale_c, s.t_linear_c[0], s.t_linear_c[1], s.r_linear, s.blend_band])?;
        let possible = |ok: bool, what| {
            if ok {
                Ok(())
            } else {
                Err(BlockError::Absurd(what))
            }
        };
        possible(s.t_ref_c.abs() <= 300.0, "reference temperature")?;
        possible((0.1..=1000.0).contains(&s.t_scale_c), "temperature scale")?;
        possible(s.t_linear_c[0] < s.t_linear_c[1], "temperature range")?;
        possible(s.r_linear > 0.0, "range of the rate of change")?;
        possible(s.blend_band >= 0.0, "blend band")?;
        for a in &self.axes {
            if !a.law.f0_hz.is_finite() {
                return Err(BlockError::NotFinite);
            }
            finite(&a.law.c)?;
            finite(&[
                a.law.scale_hz,
                a.law.min_c,
                a.law.max_c,
                a.scale_factor_dph_per_code,
                a.train_rms_dph,
                a.verify_rms_dph,
            ])?;
            finite(&a.rate_range_c_per_min)?;
            finite(&a.coefficient_std[0])?;
            finite(&a.coefficient_std[1])?;
            match &a.coefficients {
                Coefficients::One(k) => finite(k)?,
                Coefficients::CoolingHeating(c, h) => {
                    finite(c)?;
                    finite(h)?;
                }
                Coefficients::FourParameter(m) => {
                    finite(&m.k)?;
                    finite(&[m.breakpoint_c, m.origin_c])?;
                }
                Coefficients::Direct(k) => finite(k)?,
                Coefficients::Network(w) => finite(w)?,
            }
            let centres = if a.law.is_of_sensor() { -273.15..=500.0 } else { 100.0..=100_000.0 };
            possible(centres.contains(&a.law.f0_hz), "centre frequency")?;
            possible((1e-3..=1e4).contains(&a.law.scale_hz), "frequency scale")?;
            possible(a.law.min_c < a.law.max_c && a.law.min_c >= -273.15 && a.law.max_c <= 500.0, "temperature range")?;
            possible(a.scale_factor_dph_per_code != 0.0, "scale factor")?;
            possible(a.rate_range_c_per_min[0] <= a.rate_range_c_per_min[1], "range of the rate of change")?;
        }
        for e in &self.effects {
            finite(&e.parameters)?;
            for (g, d) in e.gains.iter().zip(&e.gain_std) {
                finite(g)?;
                finite(d)?;
            }
            match shape(e.id) {
                None => return Err(BlockError::UnknownEffect(e.id)),
                Some(s) if !s.on_unit => return Err(BlockError::NotOnUnit(e.id)),
                Some(_) => {}
            }
        }
        Ok(())
    }
}

/// What stands for the name of a unit that has none yet: its flash holds no valid calibration image.
pub const UNNAMED: [u8; 16] = *b"default\0\0\0\0\0\0\0\0\0";

/// A unit's name, as blocks and the link carry it, as text.
#[must_use]
pub fn unit_text(unit: &[u8; 16]) -> &str {
    let end = unit.iter().position(|&b| b == 0).unwrap_or(unit.len());
    core::str::from_utf8(&unit[..end]).unwrap_or("?")
}

/// Scale factor of a unit that was never calibrated: 20 deg/s at the end of 24 bits.
pub const DEFAULT_SCALE_FACTOR: f32 = 72_000.0 / 8_388_608.0;

fn finite(values: &[f32]) -> Result<(), BlockError> {
    for v in values {
        if !v.is_finite() {
            return Err(BlockError::NotFinite);
        }
        if v.abs() > ABSURD {
            return Err(BlockError::Absurd("coefficient"));
        }
    }
    Ok(())
}

/// The checksum that stands at the end of a block; `None` where there is no room for one.
#[must_use]
pub fn stored_checksum(bytes: &[u8]) -> Option<u32> {
    let length = u16::from_le_bytes(*bytes.get(6..8)?.first_chunk()?);
    let end = usize::from(length);
    Some(u32::from_le_bytes(*bytes.get(end.checked_sub(4)?..end)?.first_chunk()?))
}

/// What the two flash sectors hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The newest valid block, with the sector it came from (0 or 1).
    pub newest: Option<(Calibration, u8)>,
    /// Why a sector's content was refused that is no valid block and not erased either: a block whose memory has changed, or
    /// one whose writing was cut short. The unit says so ([`crate::status::unit::BLOCK_REFUSED`]), for the one in use may be
    /// the older.
    pub refused: Option<BlockError>,
}

/// Looks at both sectors.
#[inline(never)]
#[must_use]
pub fn newest(a: &[u8], b: &[u8]) -> Found {
    // A block is large, and the unit's stack small: one at a time, and the one that is used is read once more.
    let number = |bytes| Calibration::from_bytes(bytes).map(|c| c.sequence);
    let (x, y) = (number(a), number(b));
    let refused = [x.err(), y.err()].into_iter().flatten().find(|e| *e != BlockError::NoBlock);
    let sector = match (x, y) {
        // Sequence numbers compare across their wrap.
        (Ok(x), Ok(y)) if y.wrapping_sub(x) as i32 > 0 => Some(1),
        (Ok(_), _) => Some(0),
        (Err(_), Ok(_)) => Some(1),
        (Err(_), Err(_)) => None,
    };
    let read = |sector| Some((Calibration::from_bytes(if sector == 0 { a } else { b }).ok()?, sector));
    Found { newest: sector.and_then(read), refused }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn full() -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.set_unit_name("HRG-101");
        c.sequence = 7;
        c.axes[1].coefficients = Coefficients::CoolingHeating([1.5; TERMS], [-2.5e-3; TERMS]);
        for id in [4u16, 6, 3] {
            let outputs = shape(id).expect("in the list").outputs;
            let mut e = EffectTerm {
                id,
                parameters: [600.0, 1.0],
                gains: [[0.0; MAX_OUTPUTS]; AXES],
                gain_std: [[0.0; MAX_OUTPUTS]; AXES],
            };
            for g in &mut e.gains {
                g[..outputs].fill(0.125);
            }
            c.effects.push(e).expect("room");
        }
        c
    }

    fn others() -> Calibration {
        let mut c = full();
        let m = FourParameter { k: [1.0, 2.0, 3.0, 4.0, 5.0], breakpoint_c: 12.5, origin_c: -3.0 };
        c.axes[0].coefficients = Coefficients::FourParameter(m);
        c.axes[1].coefficients = Coefficients::Direct([0.5; 7]);
        c.axes[2].coefficients = Coefficients::Network([-1.25; 16]);
        c
    }

    #[test]
    fn there_and_back() {
        for c in [Calibration::uncalibrated(), full(), others()] {
            let bytes = c.to_bytes().expect("fits");
            assert_eq!(Calibration::from_bytes(&bytes), Ok(c.clone()));
            let mut sector = [0xFFu8; 4096];
            sector[..bytes.len()].copy_from_slice(&bytes);
            assert_eq!(Calibration::from_bytes(&sector), Ok(c));
        }
    }

    #[test]
    fn the_largest_block_fits() {
        let mut c = full();
        c.effects.clear();
        for axis in &mut c.axes {
            // The longest of all.
            axis.coefficients = Coefficients::Network([1.0; 16]);
        }
        for _ in 0..MAX_EFFECTS {
            c.effects
                .push(EffectTerm { id: 3, parameters: [0.0; 2], gains: [[1.0; 8]; 3], gain_std: [[1.0; 8]; 3] })
                .expect("room");
        }
        assert!(c.to_bytes().is_some());
    }

    #[test]
    fn each_defect_has_its_error() {
        let good = full().to_bytes().expect("fits");
        assert_eq!(Calibration::from_bytes(&[]), Err(BlockError::NoBlock));
        assert_eq!(Calibration::from_bytes(&[0xFF; 64]), Err(BlockError::NoBlock));
        let mut b = good.clone();
        b[4] = 9;
        assert_eq!(Calibration::from_bytes(&b), Err(BlockError::Version(9)));
        assert_eq!(Calibration::from_bytes(&good[..good.len() - 1]), Err(BlockError::Length(good.len() as u16)));
        let mut b = good.clone();
        b[40] ^= 1;
        assert_eq!(Calibration::from_bytes(&b), Err(BlockError::Checksum));
        let refused = |edit: &dyn Fn(&mut Calibration)| {
            let mut c = full();
            edit(&mut c);
            Calibration::from_bytes(&c.to_bytes().expect("fits")).expect_err("must be refused")
        };
        assert_eq!(refused(&|c| c.scaling.t_ref_c = f32::NAN), BlockError::NotFinite);
        assert_eq!(refused(&|c| c.axes[2].law.f0_hz = f64::INFINITY), BlockError::NotFinite);
        assert_eq!(refused(&|c| c.axes[0].scale_factor_dph_per_code = 0.0), BlockError::Absurd("scale factor"));
        assert_eq!(refused(&|c| c.axes[0].law.f0_hz = 3.0), BlockError::Absurd("centre frequency"));
        let sensor = |c: &mut Calibration, centre: f32| {
            c.axes[0].law = TemperatureLaw {
                f0_hz: f64::from(centre),
                scale_hz: 46.0,
                c: [centre, 46.0, 0.0, 0.0],
                ..c.axes[0].law
            };
        };
        assert_eq!(refused(&|c| sensor(c, 600.0)), BlockError::Absurd("centre frequency"));
        let mut c = full();
        sensor(&mut c, 28.0);
        assert_eq!(Calibration::from_bytes(&c.to_bytes().expect("fits")).as_ref(), Ok(&c));
        assert_eq!(refused(&|c| c.effects[0].gains[0][0] = 1e9), BlockError::Absurd("coefficient"));
        assert_eq!(refused(&|c| c.effects[0].id = 11), BlockError::NotOnUnit(11));
        let nan = |c: &mut Calibration| c.axes[1].coefficients = Coefficients::Network([f32::NAN; 16]);
        assert_eq!(refused(&nan), BlockError::NotFinite);
    }

    #[test]
    fn every_single_flipped_bit_is_found() {
        let good = full().to_bytes().expect("fits");
        for bit in 0..good.len() * 8 {
            let mut b = good.clone();
            b[bit / 8] ^= 1 << (bit % 8);
            assert!(Calibration::from_bytes(&b).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = full().to_bytes().expect("fits");
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let found = newest(&bad, &[0xFF; MAX_BYTES]);
            assert!(found.newest.is_none() && found.refused.is_some(), "bit {bit}: {found:?}");
        }
    }

    #[test]
    fn newest_valid_block_wins() {
        let (mut x, mut y) = (full(), full());
        x.sequence = u32::MAX;
        y.sequence = 0;
        let (bx, mut by) = (x.to_bytes().expect("fits"), y.to_bytes().expect("fits"));
        assert_eq!(newest(&bx, &by), Found { newest: Some((y, 1)), refused: None });
        by[20] ^= 4;
        let refused = Some(BlockError::Checksum);
        assert_eq!(newest(&bx, &by), Found { newest: Some((x, 0)), refused }, "the older is used, and that is said");
        assert_eq!(newest(&[0xFF; 8], &by), Found { newest: None, refused });
        assert_eq!(newest(&[0xFF; 8], &[]), Found { newest: None, refused: None });
    }

    proptest! {
        #[test]
        fn garbage_is_refused_not_panicked_on(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let mut b = MAGIC.to_vec();
            b.extend([1, 0]);
            b.extend(bytes);
            prop_assert!(Calibration::from_bytes(&b).is_err());
        }
    }
}
