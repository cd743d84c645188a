/* Calls an S-function as Simulink would: for the tests alone. */
int failed(const SimStruct *S);
int failed(const SimStruct *S)
{
    return S->error != NULL;
}

void started(SimStruct *S);
void started(SimStruct *S)
{
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    mdlInitializeConditions(S);
}

void called(SimStruct *S);
void called(SimStruct *S)
{
    mdlOutputs(S, 0);
    mdlUpdate(S, 0);
    mdlTerminate(S);
}
