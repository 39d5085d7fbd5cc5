//! Signals that the board's pins carry, and the places in the list of what was found right.

/// A signal of the board that a pin must carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Capture input of TIM2: 0 to 2 the resonators, 3 data-ready.
    Capture(usize),
    Pulse,
    BusClock,
    FromAdc,
    ToAdc,
    LinkOut,
    LinkIn,
    /// Outputs of the program's own.
    Select,
    Reset,
    Mark,
}

/// Places in the list of what pins carry: the signals, and both ends of each jumper.
pub const SIGNALS: usize = FIRST_JUMPER + 2 * JUMPERS;
/// First place of the jumpers' signals.
pub const FIRST_JUMPER: usize = 13;
/// Most jumpers.
pub const JUMPERS: usize = 16;

impl Signal {
    /// Its place in the list.
    pub fn index(self) -> usize {
        match self {
            Self::Capture(n) => n,
            Self::Pulse => 4,
            Self::BusClock => 5,
            Self::FromAdc => 6,
            Self::ToAdc => 7,
            Self::LinkOut => 8,
            Self::LinkIn => 9,
            Self::Select => 10,
            Self::Reset => 11,
            Self::Mark => 12,
        }
    }

    /// Its name in the tables; none: an output of the program.
    pub fn name(self) -> &'static str {
        match self {
            Self::Capture(0) => "TIM2_CH1",
            Self::Capture(1) => "TIM2_CH2",
            Self::Capture(2) => "TIM2_CH3",
            Self::Capture(_) => "TIM2_CH4",
            Self::Pulse => "TIM3_CH1",
            Self::BusClock => "SPI1_SCK",
            Self::FromAdc => "SPI1_MISO",
            Self::ToAdc => "SPI1_MOSI",
            Self::LinkOut => "USART1_TX",
            Self::LinkIn => "USART1_RX",
            Self::Select | Self::Reset | Self::Mark => "",
        }
    }

    /// `true` if the chip drives it.
    pub fn drives(self) -> bool {
        !matches!(self, Self::Capture(_) | Self::Pulse | Self::FromAdc | Self::LinkIn)
    }

    /// Its name on the board.
    pub fn wire(self) -> &'static str {
        match self {
            Self::Capture(0) => "the edge of resonator x",
            Self::Capture(1) => "the edge of resonator y",
            Self::Capture(2) => "the edge of resonator z",
            Self::Capture(_) => "the ADC's data-ready",
            Self::Pulse => "the pulse per second",
            Self::BusClock => "the ADC's clock",
            Self::FromAdc => "the data line from the ADC",
            Self::ToAdc => "the data line to the ADC",
            Self::LinkOut => "the link out",
            Self::LinkIn => "the link in",
            Self::Select => "the ADC's chip select",
            Self::Reset => "the ADC's SYNC/RESET",
            Self::Mark => "the sample mark",
        }
    }
}
