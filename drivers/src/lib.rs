//! What MoBeE drives: the simulated robot behind the driver contract.
