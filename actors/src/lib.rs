//! Who runs: supervision, driver, history, supervise, reflex, model, agent and journal as supervised actors.
