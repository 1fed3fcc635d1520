"""From a marker take to rows: cleaning, alignment, binding, helmet."""
