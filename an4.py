import pickle,numpy as np,math
R=pickle.load(open("/tmp/h-close/corpus.pkl","rb"))[0]+pickle.load(open("/tmp/h-close/sup.pkl","rb"))[0]
import os
if os.path.exists("/tmp/h-close/rnd.pkl"): R+=pickle.load(open("/tmp/h-close/rnd.pkl","rb"))[0]
seen=set(); o=[]
for r in R:
    d=r["dyn"]
    if "WING" not in r["conf"] or not d or not math.isinf(r["gh"]) or r["mach"]>=1: continue
    if not np.array_equal(r["alpha"],d["alpha"],equal_nan=True): continue
    key=(r["f"],r["ci"],r["conf"],r["mach"])
    if key in seen: continue
    seen.add(key)
    m=np.abs(r["alpha"])<=6
    k=m&np.isfinite(d["Cn_phat"]+r["CL"]+r["CD"])
    if k.sum()<2 or np.ptp(r["CL"][k])<.1: continue
    s=np.polyfit(r["CL"][k],d["Cn_phat"][k],1)[0]
    q=r["deck"]
    try: A=4*q["ss"]**2/((q["cr"]+q["ct"])*q["ss"])
    except Exception: A=np.nan
    CLa=np.polyfit(np.radians(r["alpha"][k]),r["CL"][k],1)[0]
    kk=np.nan
    if k.sum()>=4: kk=np.polyfit(r["CL"][k],r["CD"][k],2)[0]
    clp=np.nanmedian(d["Cl_phat"][k])
    su=(1/CLa-kk)/(1/CLa-1/math.pi/A)
    o.append((round(s,4),round(su,3),round(A,2),q["sw"],round(r["mach"],2),round(clp/CLa,4),round(CLa,2),r["f"][-22:],r["conf"],k.sum()))
o.sort(key=lambda x:-x[0])
for x in o[:28]: print(*x)
S=np.array([x[:7] for x in o],float)
for lo,hi in((-9,0),(0,.3),(.3,.5),(.5,.7),(.7,.9),(.9,9)):
    q=S[(S[:,1]>=lo)&(S[:,1]<hi)]; print(lo,hi,len(q),(q[:,0]>0).sum(),q[:,0].max() if len(q) else "")
q=S[S[:,2]>4.]; print("A>4",len(q),(q[:,0]>0).sum(),"A>4 &sweep<40",((S[:,2]>4)&(S[:,3]<40)).sum(),((S[:,2]>4)&(S[:,3]<40)&(S[:,0]>0)).sum())
