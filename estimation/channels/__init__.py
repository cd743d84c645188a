"""Check of the channels of a recording before an estimate: wiring, lags, and how to state them."""
