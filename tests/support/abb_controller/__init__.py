"""A simulated ABB IRC5 on loopback: Robot Web Services 1.0 and EGM, with a simulated cell behind them.

The RAPID program that it has loaded is the module `zerobeam_egm` of task T_ROB1. Its data, all PERS:

| name       | type        | written by | meaning |
|------------|-------------|------------|---------|
| zb_target  | jointtarget | client     | where command 1 goes; robax in degrees, extax 9E9 |
| zb_speed   | num         | client     | percent of the top speeds (VelSet), 1 to 100; at first 10 |
| zb_command | num         | client     | 1: MoveAbsJ to zb_target; 2: EGM guidance; 0: ends it |
| zb_start   | bool        | both       | TRUE: carry zb_command out; FALSE by RAPID once it has begun |
| zb_done    | num         | RAPID      | how many commands have ended, well or badly |
| zb_error   | num         | RAPID      | 0: the last one ended well; 1: no EgmSensor came for the time-out |

The hand-shake: `main` sets zb_start FALSE and zb_command 0 when it begins (the client writes -1 before and
so sees it), waits for zb_start, sets it FALSE, sets zb_error 0 and carries zb_command out; at the end it
sets zb_error, then zb_done := zb_done + 1, and waits again. The client reads zb_done, writes zb_target,
zb_speed and zb_command, then zb_start := TRUE, and waits until zb_done has risen. PERS outlive a `resetpp`.

While command 1 moves the arm, the client writes zb_command := 1 again and again. Every second it is set to
0; found at 0 then, the client or the cable is gone: the arm stops, zb_error is 1, and the program ends. A
target outside the limits stops the execution as well (motion errors do, no error handler catches them). In
both cases zb_done does not rise.

Command 2 runs EGMSetupUC (CommTimeout 1 s), EGMActJoint (MaxSpeedDeviation 20 deg/s) and EGMRunJoint: while
it lasts, EgmRobot goes to the client every 4 ms and the planned joints (degrees) of EgmSensor are followed.
It ends with zb_error 0 once zb_command is no longer 2 and the arm is at rest, with zb_error 1 where no
EgmSensor came for the time-out. The arm stays where it is then (EGM_STOP_HOLD).

The execution starts in automatic mode with the motors on only; an emergency stop, the mode switch and
motors off stop it, and the arm brakes on its way.

The laser is the digital output `zb_laser` (network Local, unit DRV_1 in the simulated controller).
"""
