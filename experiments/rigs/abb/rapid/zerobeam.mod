MODULE zerobeam_egm
    ! Moves of zerobeam, for a controller with the options EGM (689-1) and PC interface (616-1).
    ! Load it into T_ROB1, where its main must be the only one. docs/abb.md says what has to be configured.
    !
    ! The hand-shake: main waits for zb_start, sets it FALSE and carries zb_command out; at the end it sets
    ! zb_error (0: well, 1: the computer was silent), then adds 1 to zb_done.

    PERS jointtarget zb_target:=[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    PERS num zb_speed:=10;
    PERS num zb_command:=0;
    PERS bool zb_start:=FALSE;
    PERS num zb_done:=0;
    PERS num zb_error:=0;

    ! seconds without a word of the computer: of a far move, of guidance
    LOCAL CONST num patience:=1;
    LOCAL CONST num cycle:=0.05;
    LOCAL CONST egm_minmax settled:=[-0.01,0.01];
    LOCAL VAR intnum watch;
    LOCAL VAR egmident guide_id;
    LOCAL VAR bool silent:=FALSE;

    PROC main()
        VAR num command;

        ! PERS outlive a move of the program pointer.
        IDelete watch;
        zb_start:=FALSE;
        zb_command:=0;
        ConfJ\Off;
        SingArea\Off;
        WHILE TRUE DO
            WHILE NOT zb_start DO
                WaitTime 0.01;
            ENDWHILE
            zb_start:=FALSE;
            zb_error:=0;
            command:=zb_command;
            TEST command
            CASE 1:
                far;
            CASE 2:
                guided;
            DEFAULT:
            ENDTEST
            zb_done:=zb_done+1;
        ENDWHILE
    ENDPROC

    ! Command 1. While the arm is on its way the computer writes zb_command := 1 again and again; here it is
    ! set to 0 at each tick, and one that is found at 0 means that the computer, or the cable, is gone.
    LOCAL PROC far()
        VelSet zb_speed,5000;
        CONNECT watch WITH unheard;
        ITimer patience,watch;
        MoveAbsJ zb_target\NoEOffs,vmax,fine,tool0;
        IDelete watch;
    ENDPROC

    LOCAL TRAP unheard
        IF zb_command=0 THEN
            StopMove\Quick;
            IDelete watch;
            zb_error:=1;
            EXIT;
        ENDIF
        zb_command:=0;
    ENDTRAP

    ! Command 2. The joints follow what comes by EGM until zb_command is no longer 2.
    LOCAL PROC guided()
        silent:=FALSE;
        EGMReset guide_id;
        EGMGetId guide_id;
        EGMSetupUC ROB_1,guide_id,"default","ZEROBEAM"\Joint\CommTimeout:=patience;
        follow;
        IF silent zb_error:=1;
        EGMReset guide_id;
    ENDPROC

    LOCAL PROC follow()
        EGMActJoint guide_id\J1:=settled\J2:=settled\J3:=settled\J4:=settled\J5:=settled\J6:=settled
            \SampleRate:=4\MaxSpeedDeviation:=20;
        EGMRunJoint guide_id,EGM_STOP_HOLD\NoWaitCond\J1\J2\J3\J4\J5\J6\CondTime:=1E9\RampInTime:=0.05;
        WHILE zb_command=2 AND EGMGetState(guide_id)=EGM_STATE_RUNNING DO
            WaitTime cycle;
        ENDWHILE
        ! Guidance that has ended by itself has lost the computer.
        silent:=EGMGetState(guide_id)<>EGM_STATE_RUNNING;
        IF NOT silent EGMStop guide_id,EGM_STOP_HOLD;
    ERROR
        IF ERRNO=ERR_UDPUC_COMM THEN
            silent:=TRUE;
            RETURN;
        ENDIF
        RAISE;
    ENDPROC
ENDMODULE
