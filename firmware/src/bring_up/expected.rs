//! What the virtual board says of each row of the table: printed by `cargo xtask bring-up --virtual --expect`; not written by hand.

/// In the order of the rows: name, figure.
pub const EXPECTED: [(&str, f32); super::table::ROWS] = [
    ("wave x (PB9-PA0): frequency", 4900.093),
    ("wave y (PA8-PA1): frequency", 4891.969),
    ("wave z (PB14-PB10): frequency", 4703.669),
    ("wave x: shortest period captured", 18366.0),
    ("wave x: longest period captured", 18368.0),
    ("waves x, y, z: edges missing or rejected", 0.0),
    ("data-ready (PC9-PB2): samples a second", 1000.0),
    ("ADC frames (PB6-PB12, PA5-PB13, PA7-PC3, PC2-PA6): refused", 0.0),
    ("corrected rate x", 85.83069),
    ("corrected rate y", -171.66138),
    ("corrected rate z", 257.49207),
    ("ADC reset (PC7-PC0): resets after three bad frames", 1.0),
    ("link out (PA9-PD2): rate frames a second", 200.0),
    ("link out (PA9-PD2): bad frames", 0.0),
    ("link in (PC12-PA10): answers to a question", 1.0),
    ("pulses per second (PB8-PC6): taken", 4.0),
    ("pulses per second: the unit's clock is fast by", 0.0),
    ("flags of the unit: no calibration, and nothing else", 16.0),
    ("data-ready to corrected sample: mean", 5822.3477),
    ("data-ready to corrected sample: worst", 7015.0),
    ("bias update", 5510.125),
    ("load of the unit's tasks", 2.4413834),
    ("erase of sector 2", 500.00406),
    ("start of the clocks to the first rate frame", 112.678),
];
