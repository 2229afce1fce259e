import pickle,numpy as np,math
exec(open("/tmp/h-close/an2.py").read().split("print(len(out))")[0])
for o in out:
    if o[9]>1 or (np.isfinite(o[9]) and o[9]<.02): print(o)
R,H=pickle.load(open("/tmp/h-close/sup.pkl","rb"))
for r in R[:0]: pass
n=0;s=[]
for r in R:
    d=r["dyn"]
    if "WING" not in r["conf"] or not d: continue
    m=np.abs(r["alpha"])<=6
    k=m&np.isfinite(d["Cn_phat"]+r["CL"])
    if k.sum()>=2: s.append((r["mach"],np.polyfit(r["CL"][k],d["Cn_phat"][k],1)[0]))
s=np.array(s); print(len(s)); 
for lo,hi in((0,.7),(.7,1),(1,1.4),(1.4,9)):
    q=s[(s[:,0]>=lo)&(s[:,0]<hi),1]; print(lo,hi,len(q),(q>0).sum(), np.percentile(q,[0,5,50,95,100]).round(4) if len(q) else "")
