//! A calibration to the bytes that lie in flash, and back.

use super::{BlockError, Calibration, EffectTerm, Uncertainty, DIRECTIONS, MAGIC, MAX_BYTES, OLDEST, VERSION};
use crate::bias::four_parameter::FourParameter;
use crate::bias::{Coefficients, Scaling};
use crate::bytes::{crc32, Reader, Writer};
use crate::effects::{shape, Shape, MAX_OUTPUTS};
use crate::temperature::TemperatureLaw;
use crate::unit_name::UnitName;
use crate::AXES;
use heapless::Vec;

/// Bytes before the payload.
const HEADER: usize = 8;

impl Calibration {
    /// The block, ready for flash. `None` cannot happen for a value that [`from_bytes`](Self::from_bytes) gave.
    #[must_use]
    pub fn to_bytes(&self) -> Option<Vec<u8, MAX_BYTES>> {
        let mut buffer = [0u8; MAX_BYTES];
        let mut w = Writer::new(&mut buffer);
        w.bytes(&MAGIC);
        w.u16(self.version());
        w.u16(0);
        self.write_payload(&mut w);
        if self.version() >= 2 {
            self.write_since_2(&mut w);
        }
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
        Self::from_bytes_up_to(VERSION, bytes)
    }

    /// The same by a program whose newest version is this.
    pub(super) fn from_bytes_up_to(newest: u16, bytes: &[u8]) -> Result<Self, BlockError> {
        let mut header = Reader::new(bytes);
        if header.array::<4>() != Some(MAGIC) {
            // An erased sector holds no fault; a block whose first bytes are upset does.
            let erased = bytes.iter().take(MAX_BYTES).all(|b| *b == 0xFF);
            return Err(if erased { BlockError::NoBlock } else { BlockError::Foreign });
        }
        let version = header.u16().ok_or(BlockError::Length(0))?;
        let length = header.u16().ok_or(BlockError::Length(0))?;
        if !(OLDEST..=newest).contains(&version) {
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
        if version >= 2 {
            calibration.read_since_2(&mut payload).ok_or(BlockError::Length(length))??;
        }
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
        w.bytes(self.unit.bytes());
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

    /// The oldest version that holds all that is stated: an older program reads it, and an image of an older version keeps its checksum.
    fn version(&self) -> u16 {
        let started = self.effects.iter().any(|e| e.start != 0.0);
        if started || self.axes.iter().any(|a| a.uncertainty != Uncertainty::default()) {
            VERSION
        } else {
            1
        }
    }

    /// Directions that hold anything: the others are not written.
    fn directions(&self) -> usize {
        let any = |k: usize| {
            let mut own = self.axes.iter().flat_map(|a| a.uncertainty.baseline[k]);
            let mut effects = self.effects.iter().flat_map(|e| e.directions[k].iter().flatten());
            own.any(|v| v != 0.0) || effects.any(|v| *v != 0.0)
        };
        (0..DIRECTIONS).rev().find(|k| any(*k)).map_or(0, |k| k + 1)
    }

    fn write_since_2(&self, w: &mut Writer<'_>) {
        for e in &self.effects {
            w.f32(e.start);
        }
        w.f32s(&self.axes.each_ref().map(|a| a.uncertainty.rest_dph2));
        let count = self.directions();
        w.u8(count as u8);
        for k in 0..count {
            for (number, axis) in self.axes.iter().enumerate() {
                w.f32s(&axis.uncertainty.baseline[k]);
                for e in &self.effects {
                    let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs);
                    w.f32s(&e.directions[k][number][..outputs]);
                }
            }
        }
    }

    /// Since version 2.
    #[inline(never)]
    fn read_since_2(&mut self, r: &mut Reader<'_>) -> Option<Result<(), BlockError>> {
        for e in &mut self.effects {
            e.start = r.f32()?;
        }
        let rest: [f32; AXES] = r.f32s()?;
        for (a, rest_dph2) in self.axes.iter_mut().zip(rest) {
            a.uncertainty = Uncertainty { rest_dph2, ..Uncertainty::default() };
        }
        let count = usize::from(r.u8()?);
        if count > DIRECTIONS {
            return Some(Err(BlockError::Absurd("number of directions")));
        }
        for k in 0..count {
            for (number, axis) in self.axes.iter_mut().enumerate() {
                axis.uncertainty.baseline[k] = r.f32s()?;
                for e in &mut self.effects {
                    let outputs = shape(e.id).map_or(MAX_OUTPUTS, |f| f.outputs);
                    r.fill(&mut e.directions[k][number][..outputs])?;
                }
            }
        }
        Some(Ok(()))
    }

    /// Reads what a block of version 1 holds; `None` where it is too short.
    #[inline(never)]
    fn read_payload(&mut self, r: &mut Reader<'_>) -> Option<Result<(), BlockError>> {
        self.unit = UnitName::from_bytes(r.array()?);
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
            let mut e = EffectTerm::new(id, r.f32s()?);
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
}
