"""The diagnosis of a mechanism before anything is planned. Open `diagnosis` first.

* `diagnosis`: the findings, and what to do about what is wrong or remarkable;
* `mobility`: degrees of freedom, and the axes along which the platform can move;
* `proposal`: platform, axes, motors and reference where a file is silent;
* `assembly_search`: closed poses of a mechanism whose reference is none.
"""
