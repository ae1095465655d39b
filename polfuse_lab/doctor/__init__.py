"""What is wrong with a rig and with the computer it hangs on, and how to mend it. Changes nothing, never hangs."""

from polfuse_lab.doctor.devices import examine, examine_device
from polfuse_lab.doctor.facts import Facts, gather
from polfuse_lab.doctor.findings import Finding
from polfuse_lab.doctor.system import judge

__all__ = ["Facts", "Finding", "examine", "examine_device", "gather", "judge"]
