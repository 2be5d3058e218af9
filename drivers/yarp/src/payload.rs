//! What messages carry besides bottles (spec sections 11, 13, 14, 16).
