"""The diagnosis of a mechanism before anything is planned. Open `diagnosis` first.

* `diagnosis`: the findings, with advice on faults and unusual properties; the description of one pose;
* `mistaken_units`: remarks on masses, sizes and inertias that seem to be in another unit;
* `mobility`: degrees of freedom, and the axes along which the platform can move;
* `proposal`: platform, axes, motors and reference where a file states none;
* `regular_reference`: a reference away from singularities.
"""
