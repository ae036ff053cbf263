"""What pages hold for browsers: charts with values on hover, bars over time, a view of surfaces, and libraries."""
